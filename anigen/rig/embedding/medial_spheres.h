#pragma once
#include <Eigen/Core>
#include <cstddef>
#include <vector>

#include "anigen/rig/embedding/solid_field.h"

namespace anigen::rig {

struct Sphere {
  Eigen::Vector3d center = Eigen::Vector3d::Zero();
  double radius = 0.0;
};

/// Points of the medial surface of a solid with their distance to its boundary (reference anymate-baselines.md, 9.2,
/// stage 2): where the directions away from the nearest boundary points of two neighbouring cells are at a right angle
/// or more. Taken between the cells, where both boundary points are equally far, so closer than the grid is fine.
/// Sheets are medial themselves.
/// @param least_radius smaller ones are left out, except on sheets
/// @return largest first, those of equal radius from below to above
std::vector<Sphere> medial_samples(const SolidField& field, double least_radius);

/// A greedy packing (stage 3): in order, those whose centre lies in none that was taken before.
/// @param most ends the packing
std::vector<Sphere> packed_spheres(const std::vector<Sphere>& samples, std::size_t most);

/// Distance to the nearest sample at every cell of the field's grid, to be used with interpolate().
std::vector<float> distance_to_medial(const SolidField& field, const std::vector<Sphere>& samples);

}  // namespace anigen::rig
