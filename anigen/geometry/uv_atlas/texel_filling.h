#pragma once
#include <Eigen/Core>
#include <vector>

namespace anigen::geometry {

/// Gives the texels without a colour one that changes smoothly from those around (push and pull over a pyramid of
/// means, Gortler et al. 1996, section 3.4); texels with a colour keep it. Black when none has one.
/// @param known per texel, 0 for those to fill @param texels [size · size]
void fill_unknown_texels(int size, const std::vector<char>& known, std::vector<Eigen::Vector3f>& texels);

}  // namespace anigen::geometry
