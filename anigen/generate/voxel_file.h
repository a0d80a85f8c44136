#pragma once
#include <cstdint>
#include <string>

#include "anigen/sparse_structure/voxel_picture.h"

namespace anigen::generate {

/// Voxels of a first flow as the contents of a file: NPZ with `shape` and `skeleton`, u8 [N, 3] each, x, y, z
/// ascending, and `resolution`, i64 [1]. @param voxels bool [R, R, R] each, R at most 256 @throws WriteError
std::string npz_of_voxels(const sparse_structure::VoxelPair& voxels);

/// The voxels that such contents hold, from whatever source. @param name for messages
/// @param grid R of the flows that go on from them @param with_skeleton false: flows of the shape alone
/// @return bool [R, R, R] each @throws InputError naming it, for damaged contents, for arrays of another dtype or
/// shape, voxels outside the grid, another resolution, or where there are no voxels
sparse_structure::VoxelPair voxels_of_npz(const std::string& contents, const std::string& name, std::int64_t grid,
                                          bool with_skeleton);

}  // namespace anigen::generate
