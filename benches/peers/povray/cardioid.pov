// scenes/cardioid.toml for POV-Ray. Declare=Photons, Lights (lamps along each side of a disc that stands for the sphere).
#version 3.7;
global_settings { assumed_gamma 1.0 ambient_light 0 max_trace_level 30 photons { count Photons media 0 } }
camera {
  perspective
  location <60, 380, -230>
  right -x
  up y
  direction z
  look_at <0, 10, 0>
  angle 34
}
polygon {
  5, <-400, 0, -400>, <-400, 0, 400>, <400, 0, 400>, <400, 0, -400>, <-400, 0, -400>
  pigment { rgb 0.75 }
  finish { ambient 0 diffuse 1 }
}
cylinder {
  <0, 0, 0>, <0, 50, 0>, 100 open
  pigment { rgb 1 }
  finish { ambient 0 diffuse 0 reflection { 0.9 } }
  photons { target reflection on refraction off collect off }
}
// With fade_distance 1 a light of colour c makes 2 c cos / (1 + d^2) of a white surface; a sphere far away L r^2 cos / d^2.
light_source {
  <-300, 170, 0>
  color rgb <375, 350, 300> * (20 * 20 / 2)
  fade_distance 1 fade_power 2
  area_light x * 40, y * 40, Lights, Lights circular orient
  jitter area_illumination on
  photons { reflection on refraction off area_light }
}
sphere {
  <-300, 170, 0>, 20
  pigment { rgb <375, 350, 300> }
  finish { ambient 0 diffuse 0 emission 1 }
  no_shadow
  photons { pass_through }
}
