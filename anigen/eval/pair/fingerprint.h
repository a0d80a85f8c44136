#pragma once
#include <cstdint>

#include "anigen/io/rigs/rigged_shape.h"

namespace anigen::eval {

/// A hash of everything metrics look at: geometry, skeleton, weights, colours, clips. Two files with the same content
/// agree; a prediction that was made again differs, so that no saved result outlives its input.
std::uint64_t fingerprint(const io::RiggedShape& shape);

}  // namespace anigen::eval
