#pragma once
#include <Eigen/Core>
#include <cstdint>
#include <vector>

#include "anigen/core/random.h"

namespace anigen::eval {

/// A rotation uniform over SO(3), from three draws (Shoemake, Uniform random rotations, Graphics Gems III, 1992).
Eigen::Matrix3d random_rotation(Rng& rng);

/// `count` of them; rotation i comes from the stream (seed, "alignment rotation", i), so a longer list starts with a
/// shorter one.
std::vector<Eigen::Matrix3d> random_rotations(int count, std::uint64_t seed);

/// Rotations that lay the principal axes of one point set onto those of another: the four choices of signs without a
/// reflection; where two variances are within 10 % of each other their axes say little, and all 24 assignments of
/// axes are tried. None when either set has no extent.
std::vector<Eigen::Matrix3d> principal_axis_rotations(const Eigen::Matrix3d& from_covariance,
                                                      const Eigen::Matrix3d& to_covariance);

}  // namespace anigen::eval
