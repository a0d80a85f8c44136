#pragma once
#include <string>

#include "tests/parity/fixture.h"

namespace anigen::test {

/// Visibility by the ray tracer, against what a mesh of the raster fixture has before antialiasing.
void check_ray_traced_visibility(Fixture& fixture, const std::string& mesh);

}  // namespace anigen::test
