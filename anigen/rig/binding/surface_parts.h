#pragma once
#include <Eigen/Core>
#include <cstdint>
#include <vector>

#include "anigen/rig/binding/welded_surface.h"

namespace anigen::rig {

/// Parts of a welded surface that hang together by faces, in the order of their first places; a place without faces is
/// a part of its own.
struct SurfaceParts {
  std::vector<std::int32_t> of_place;  ///< [P]
  std::vector<double> volumes;         ///< signed, about a place of the part: positive when faces wind outward
  std::vector<double> areas;

  std::size_t size() const { return volumes.size(); }
  /// A closed part has at most the volume of a sphere of its area; a sheet has next to none, whatever its winding.
  bool encloses_space(std::size_t part) const;
};

SurfaceParts surface_parts(const WeldedSurface& surface);

/// Area-weighted normals of places [P], unit length, pointing out of the part where the part encloses space and has
/// been wound inward, too; zero where no face gives one.
std::vector<Eigen::Vector3d> outward_normals(const WeldedSurface& surface, const SurfaceParts& parts);

}  // namespace anigen::rig
