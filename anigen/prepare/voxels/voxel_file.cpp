#include "anigen/prepare/voxels/voxel_file.h"

#include <string>

#include "anigen/core/error.h"
#include "anigen/io/ply.h"

namespace anigen::prepare {

void write_voxel_ply(const std::filesystem::path& path, std::vector<geometry::Voxel> voxels, int resolution) {
  if (voxels.empty()) throw InputError(path.string(), "", "there are no voxels to write");
  geometry::require_inside(voxels, resolution);
  geometry::sort_unique(voxels);
  Mesh centers;
  centers.vertices.reserve(voxels.size());
  for (const geometry::Voxel& voxel : voxels) {
    centers.vertices.push_back(geometry::voxel_center(voxel, resolution).cast<float>());
  }
  io::write_ply(path, centers);
}

std::vector<geometry::Voxel> read_voxel_rows(const std::filesystem::path& path, int resolution) {
  geometry::require_resolution(resolution);
  const Mesh centers = io::read_ply(path);
  std::vector<geometry::Voxel> voxels;
  voxels.reserve(centers.vertices.size());
  for (std::size_t row = 0; row < centers.vertices.size(); ++row) {
    try {
      voxels.push_back(geometry::voxel_at(centers.vertices[row].cast<double>(), resolution));
    } catch (const InputError& error) {
      throw InputError(path.string(), "vertex " + std::to_string(row), error.problem());
    }
  }
  return voxels;
}

std::vector<geometry::Voxel> read_voxel_ply(const std::filesystem::path& path, int resolution) {
  std::vector<geometry::Voxel> voxels = read_voxel_rows(path, resolution);
  geometry::sort_unique(voxels);
  return voxels;
}

}  // namespace anigen::prepare
