#pragma once
#include <cstdint>
#include <vector>

#include "anigen/rig/binding/moving_bones.h"
#include "anigen/rig/binding/voxel_block.h"
#include "anigen/rig/binding/welded_surface.h"

namespace anigen::rig {

/// The inside of a mesh as cells, whatever the mesh is like. The block is the mesh's box and one cell more all around,
/// which is always outside.
struct SolidVoxels {
  enum State : std::uint8_t { kOutside, kInside, kWall };

  VoxelBlock block;
  std::vector<std::uint8_t> states;  ///< [cells]
  std::vector<std::uint32_t> walls;  ///< cells that the surface passes through, ascending

  bool is_solid(std::size_t cell) const { return states[cell] != kOutside; }
};

/// Largest resolution: at 512 the states of a mesh that fills the grid take 136 MB, and as much as that three times
/// over while they are made.
constexpr int kMaxSolidResolution = 512;

/// Solid voxelisation (reference anymate-baselines.md, 9.1, step 1).
///  - Walls are the cells whose closed box meets a face.
///  - Inside is what a flood from outside does not reach past the walls: that needs no winding, no single surface and
///    no care about what overlaps what.
///  - Where the flood gets in through a hole, rays decide: inside is also where at least four of the six rays along the
///    axes cross the surface an odd number of times.
///  - Unless `validate` is off, what the rays found is dropped where most neighbours are outside (streaks behind an
///    open sheet), and insides that no bone comes near are dropped (the space below a skirt, a cup, a mouth): they
///    would join what they lie between.
/// The cells do not depend on the order of vertices or faces, nor on the number of threads.
/// @param bones [J] in the surface's frame
/// @throws InputError unless 2 ≤ resolution ≤ kMaxSolidResolution @pre surface.has_extent
SolidVoxels solid_voxels(const WeldedSurface& surface, const std::vector<MovingBones>& bones, int resolution,
                         bool validate = true);

}  // namespace anigen::rig
