#![doc = "A photon-mapping renderer on Embree. See `docs/` for conventions and the scene format."]
