// scenes/cornell-spheres.toml for POV-Ray. Declare=Gather, Bound, Lights as for cornell-diffuse; Photons.
#include "cornell.inc"
global_settings {
  radiosity {
    count Gather error_bound Bound recursion_limit 4 nearest_count 10 low_error_factor 0.5
    pretrace_start 0.08 pretrace_end Pretrace minimum_reuse 0.005 brightness 1 normal off
  }
  photons { count Photons media 0 }
}
sphere {
  <390, 100, 380>, 100
  pigment { rgb 1 }
  finish { ambient 0 diffuse 0 reflection { 0.95 } }
  photons { target reflection on refraction off collect off }
}
sphere {
  <170, 100, 200>, 100
  pigment { rgbt 1 }
  finish { ambient 0 diffuse 0 reflection { 0, 1 fresnel on } conserve_energy }
  interior { ior 1.5 }
  photons { target reflection on refraction on collect off }
}
Lamp(<278, 548.7, 279.5>, 60, 60, <64.45833333333333, 45.5, 15.166666666666666>, Lights)
