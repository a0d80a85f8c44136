#pragma once
#include <cstddef>
#include <filesystem>
#include <optional>
#include <string>
#include <vector>

#include "anigen/asset/rigged_asset.h"
#include "anigen/asset/rigid_parts.h"
#include "anigen/asset/skin_weights.h"
#include "anigen/geometry/simplify.h"

namespace anigen::generate {

/// Post-processing of a decoded asset before it is written; defaults are the published pipeline's, but for the number
/// of views (docs/reference/flows.md, 5.6, 5.7 and 5.8).
struct FinishingOptions {
  double reduction = geometry::kPublishedReduction;  ///< share of faces taken away, 0: none
  bool remove_hidden = true;                         ///< faces inside the mesh, and then close small holes
  std::size_t views = 200;                  ///< from which faces may be seen; published: 1000, too slow without a GPU
  int view_size = 512;                      ///< pixels; published: 1024
  bool filter_skin = true;                  ///< no weights of joints far away along the skeleton
  std::optional<int> smoothing_iterations;  ///< rounds over skin weights along the mesh, 0: none; unset: as
                                            ///< finishing_of_flow() finds, else 100 as published
  double smoothing_alpha = 1.0;
  bool rigid_parts = false;  ///< shells with this share of their weight in one joint follow it alone: rigid_parts()
  double rigid_share = kRigidShare;
  int texture_size = 1024;  ///< texels; 0: vertex colours

  /// @throws InputError naming what is out of range
  void validate() const;
};

inline constexpr int kPublishedSmoothing = 100;

/// Options with the rounds of smoothing that grouping.json of a flow's run asks for (key `smoothing`), where they are
/// unset and it says so. The published rounds suit meshes of a 256³ grid; on coarse ones they blur weights over limbs.
/// @param flow run folder of stage 5 @throws InputError for a damaged file
FinishingOptions finishing_of_flow(FinishingOptions asked, const std::filesystem::path& flow);

struct FinishedAsset {
  Asset asset;
  std::vector<std::string> notices;  ///< a sentence each: what was done, with numbers
  Json rigid_parts;                  ///< RigidSkin::to_json(), where it was asked for
};

/// Simplifies the mesh, removes hidden faces, closes small holes, carries skin weights over unless the vertices stayed
/// what they were, filters and smooths the weights, and turns vertex colours into a texture, in the published order.
/// Rigid parts, which are ours, come after smoothing. The skeleton stays as it is.
/// @param dense as decoded_asset() gives it: vertex colours, skin rows that sum to 1
/// @throws InputError on an option out of range
FinishedAsset finish_asset(const Asset& dense, const FinishingOptions& options = {});

}  // namespace anigen::generate
