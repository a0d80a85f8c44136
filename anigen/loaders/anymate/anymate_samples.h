#pragma once
#include <cstdint>
#include <string>
#include <vector>

#include "anigen/io/ndarray.h"
#include "anigen/loaders/rigged_item.h"
#include "anigen/models/anymate/collate.h"

namespace anigen::loaders {

struct AnymateConversion {
  std::size_t points = 8192;  ///< of the surface
  bool cells = false;         ///< also the cells inside, which fields of joints need
  std::uint64_t seed = 0;     ///< of the points
};

/// A rigged mesh as a sample of Anymate's data (reference anymate-baselines.md, 1.7): points with face normals,
/// uniform over the surface; bones and joints of lay_out_bones(); weights of the bones, interpolated within faces.
/// @param bone_of filled, where wanted, with the bone of each of the rig's joints, -1 for none
/// @throws InputError naming the asset: as anymate_mesh and lay_out_bones
models::anymate::AnymateSample convert_rig(const RiggedItem& item, const AnymateConversion& options = {},
                                           std::vector<int>* bone_of = nullptr);

/// A sample of a released file (reference, 1.2), as it is: pc, joints, conns, bones, skins_index, skins_weight, vox.
/// @throws InputError naming the file, the sample and the key: missing, another shape or type, not finite
models::anymate::AnymateSample read_anymate_sample(const io::NamedArrays& arrays, const std::string& name,
                                                   const std::string& file);

}  // namespace anigen::loaders
