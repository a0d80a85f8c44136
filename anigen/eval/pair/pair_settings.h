#pragma once
#include <cstdint>
#include <optional>
#include <set>
#include <string>

#include "anigen/core/json.h"
#include "anigen/eval/align/alignment.h"
#include "anigen/eval/transport/skeleton_transport.h"

namespace anigen::eval {

/// Solver of the columns wasserstein and gromov_wasserstein.
enum class TransportMethod {
  kExact,     ///< network simplex or shortest paths; conditional gradient and exchanges
  kSinkhorn,  ///< entropic, by Sinkhorn's iterations, as the paper says
};
/// @throws InputError for another word than exact and sinkhorn
TransportMethod parse_transport(const std::string& word);

/// Everything that decides a number of a pair. Recorded in metrics.json.
struct PairSettings {
  AlignmentOptions alignment;
  std::uint64_t seed = 0;  ///< of samples, starting rotations, poses
  std::size_t surface_samples = 100000;
  int image_size = 512;    ///< pixels of the views that PSNR, SSIM and LPIPS compare
  int poses = 10;          ///< of the deformation error
  int motion_frames = 12;  ///< of a clip or pose sequence that motion_distance looks at
  TransportMethod transport = TransportMethod::kExact;
  /// Of Sinkhorn, as a share of the largest squared distance; without, those of SinkhornOptions and EntropicGwOptions.
  std::optional<double> epsilon;
  /// What to compute, of the seven groups of docs/metrics.md.
  std::set<std::string> groups = {"skeleton", "transport", "skin", "surface", "image", "motion", "anymate"};

  /// Which network and weights LPIPS is computed with; null: not computed. It stands here so that no saved result
  /// outlives its weights.
  Json lpips;
  /// CategoryReferences::describe() of those that predictions are sorted by; null: not sorted. It stands here for the
  /// same reason.
  Json categories;

  /// MotionFile::described of the motion that every truth is given; null: each has its own. It stands here for the same
  /// reason.
  Json motion;

  bool wants(const std::string& group) const { return groups.count(group) > 0; }
};

Json to_json(const PairSettings& settings);

/// Options of skeleton_transport(). Gromov–Wasserstein with Sinkhorn searches nothing besides.
TransportOptions transport_options(const PairSettings& settings);

/// @throws InputError naming the option that is out of range, or an unknown group and those there are
void check(const PairSettings& settings);

}  // namespace anigen::eval
