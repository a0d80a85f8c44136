#pragma once
#include <cstddef>
#include <string>
#include <vector>

#include "anigen/asset/rigged_asset.h"
#include "anigen/core/config.h"
#include "anigen/core/table.h"
#include "anigen/io/image.h"

namespace anigen::eval {

/// Pictures beside each other. Of a skinned asset: in colour, its skin weights, its skeleton over the weights; of a
/// mesh without a rig: in colour, its normals; of a mesh beside a skeleton that does not move it: in colour, with the
/// skeleton; of a skeleton without a mesh: as a solid, at rest and in the middle of its first animation.
/// @param size of one picture in pixels @throws InputError for points without faces
io::Image asset_picture(const Asset& asset, int size = 480);

/// Weight lost when only the `influences` heaviest joints of every vertex are kept, as exporters do.
struct InfluenceLoss {
  std::size_t influences = 4;
  std::size_t affected = 0;  ///< vertices with more influences
  double mean_l1 = 0;        ///< Σ_j |w' − w| averaged over all vertices
  double max_l1 = 0;
  std::size_t frames = 0;       ///< sampled poses, over all animations
  double max_displacement = 0;  ///< of any vertex in any of them, as a part of the mesh's bounding box diagonal
};

/// @param frames_per_animation poses at equal times from the start to the end of each animation
InfluenceLoss influence_loss(const Asset& asset, std::size_t influences, std::size_t frames_per_animation = 16);

Json to_json(const InfluenceLoss& loss);

/// A file and what inspect() said about it, or why it was rejected.
struct InspectedFile {
  std::string file;
  Json description;
  std::string rejection;  ///< empty: not rejected
};

/// One row per file: joints, vertices, faces, influences, and the codes of what was repaired, a summary of what has no
/// mesh, or the reason of the rejection; with the kind where not all are assets, and the loss by fewer influences when
/// the descriptions carry it.
anigen::Table file_table(const std::vector<InspectedFile>& files);

/// The description of a single file; a list for several. A rejected file is {"file", "rejected": reason}.
Json to_json(const std::vector<InspectedFile>& files);

}  // namespace anigen::eval
