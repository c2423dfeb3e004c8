// scenes/cornell-diffuse.toml for POV-Ray. Declare=Gather (rays of a radiosity sample), Bound (its error bound), Lights
// (lamps along each side).
#include "cornell.inc"
global_settings {
  radiosity {
    count Gather error_bound Bound recursion_limit 4 nearest_count 10 low_error_factor 0.5
    pretrace_start 0.08 pretrace_end Pretrace minimum_reuse 0.005 brightness 1 normal off
  }
}

#macro Block(A, B, C, D, Height)
  Face(A + y * Height, B + y * Height, C + y * Height, D + y * Height, White)
  Face(A, B, B + y * Height, A + y * Height, White)
  Face(B, C, C + y * Height, B + y * Height, White)
  Face(C, D, D + y * Height, C + y * Height, White)
  Face(D, A, A + y * Height, D + y * Height, White)
#end
Block(<130, 0, 65>, <82, 0, 225>, <240, 0, 272>, <290, 0, 114>, 165)
Block(<423, 0, 247>, <265, 0, 296>, <314, 0, 456>, <472, 0, 406>, 330)
Lamp(<278, 548.7, 279.5>, 130, 105, <17, 12, 4>, Lights)
