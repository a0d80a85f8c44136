#include "anigen/generate/voxel_file.h"

#include <filesystem>

#include "anigen/core/error.h"
#include "anigen/core/files.h"
#include "anigen/core/private_folder.h"
#include "anigen/io/arrays/npz.h"

namespace anigen::generate {

namespace {

using torch::Tensor;

constexpr std::size_t kMostVoxelGrid = 256;                     // coordinates are bytes
constexpr std::size_t kMostVoxelBytes = std::size_t{64} << 20;  // 256³ voxels, both grids, deflated, are below it

io::NdArray places_in(const Tensor& occupied) {
  const Tensor places = torch::nonzero(occupied.to(torch::kCPU)).to(torch::kUInt8).contiguous();
  const auto* first = places.data_ptr<std::uint8_t>();
  return {io::Dtype::kU8, {places.size(0), 3}, {first, first + places.numel()}};
}

/// Occupied places as a grid. @throws InputError naming the array
Tensor grid_of(const io::NdArray& places, std::int64_t side, const std::string& file, const std::string& array) {
  if (places.shape.size() != 2 || places.shape[1] != 3)
    throw InputError(file, array, "is not of shape (any, 3): x, y, z of voxels");
  Tensor grid = torch::zeros({side, side, side}, torch::kBool);
  bool* cells = grid.data_ptr<bool>();
  for (std::size_t i = 0; i < places.bytes.size(); i += 3) {
    const std::uint8_t* xyz = places.bytes.data() + i;
    for (int axis = 0; axis < 3; ++axis) {
      if (xyz[axis] < side) continue;
      throw InputError(file, array + ", row " + std::to_string(i / 3),
                       "lies outside the grid of " + std::to_string(side) + "³ voxels");
    }
    cells[(xyz[0] * side + xyz[1]) * side + xyz[2]] = true;
  }
  return grid;
}

/// Names, dtypes and sizes are looked at before data are read, so that a false size costs no memory.
io::NamedArrays read_voxel_arrays(const std::filesystem::path& file) {
  const io::NamedArrays headers = io::read_npz_headers(file);
  for (const char* name : {"shape", "skeleton", "resolution"}) {
    const io::Dtype dtype = name == std::string("resolution") ? io::Dtype::kI64 : io::Dtype::kU8;
    const io::NdArray* header = io::find(headers, name);
    if (header == nullptr) throw InputError("", name, "is missing or no array of numbers");
    if (header->dtype != dtype)
      throw InputError("", name, "holds " + io::name_of(header->dtype) + ", not " + io::name_of(dtype));
    if (header->count() > 3 * kMostVoxelGrid * kMostVoxelGrid * kMostVoxelGrid)
      throw InputError("", name, "has more rows than a grid has voxels");
  }
  return io::read_npz(file, {"shape", "skeleton", "resolution"});
}

}  // namespace

std::string npz_of_voxels(const sparse_structure::VoxelPair& voxels) {
  const PrivateFolder folder;
  const std::filesystem::path file = folder / "voxels.npz";
  io::write_npz(file, {{"shape", places_in(voxels.shape)},
                       {"skeleton", places_in(voxels.skeleton)},
                       {"resolution", io::NdArray::from<std::int64_t>({voxels.shape.size(0)}, {1})}});
  return read_file(file);
}

sparse_structure::VoxelPair voxels_of_npz(const std::string& contents, const std::string& name, std::int64_t grid,
                                          bool with_skeleton) {
  if (contents.size() > kMostVoxelBytes)
    throw InputError(name, "", "has " + std::to_string(contents.size()) + " bytes; no voxels take so many");
  const PrivateFolder folder;
  const std::filesystem::path file = folder / "voxels.npz";
  write_file_atomically(file, contents);
  io::NamedArrays arrays;
  try {
    arrays = read_voxel_arrays(file);
  } catch (const InputError& error) {  // says the name that the caller knows
    throw InputError(name, error.place(), error.problem());
  }
  const io::NdArray& resolution = *io::find(arrays, "resolution");
  if (resolution.count() != 1) throw InputError(name, "resolution", "is not one number");
  const std::int64_t side = resolution.as<std::int64_t>().front();
  if (side != grid) {
    throw InputError(
        name, "resolution",
        "voxels of a grid of " + std::to_string(side) + "³; these flows work on " + std::to_string(grid) + "³");
  }
  sparse_structure::VoxelPair voxels{grid_of(*io::find(arrays, "shape"), side, name, "shape"),
                                     grid_of(*io::find(arrays, "skeleton"), side, name, "skeleton")};
  if (!voxels.shape.any().item<bool>()) throw InputError(name, "shape", "has no voxels");
  if (with_skeleton && !voxels.skeleton.any().item<bool>()) throw InputError(name, "skeleton", "has no voxels");
  return voxels;
}

}  // namespace anigen::generate
