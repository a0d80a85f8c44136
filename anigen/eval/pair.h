#pragma once
#include <Eigen/Core>
#include <cstdint>
#include <map>
#include <optional>
#include <set>
#include <string>
#include <vector>

#include "anigen/core/config.h"
#include "anigen/eval/metric_table.h"
#include "anigen/io/rigs/rigged_shape.h"
#include "anigen/metrics/alignment.h"
#include "anigen/metrics/image.h"
#include "anigen/metrics/motion.h"
#include "anigen/metrics/skeleton_transport.h"

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
  metrics::AlignmentOptions alignment;
  std::uint64_t seed = 0;  ///< of samples, starting rotations, poses
  std::size_t surface_samples = 100000;
  bool clip_joints = false;      ///< the truth's joints are clipped to the unit box and rounded to half precision, as
                                 ///< MagicArticulate's and Puppeteer's data sets store them
  double merge_joints = 0.0;     ///< merge_joints() of both sides at this distance, in the frame of scores; 0: none
  bool visible_surface = false;  ///< alignment and surface metrics by geometry::visible_surface() of either mesh
  int image_size = 512;          ///< pixels of the views that image metrics compare
  int poses = 10;                ///< of the deformation error
  int motion_frames = 12;        ///< of a clip or pose sequence that motion_distance looks at
  TransportMethod transport = TransportMethod::kExact;
  /// Of Sinkhorn, as a share of the largest squared distance; without, those of SinkhornOptions and EntropicGwOptions.
  std::optional<double> epsilon;
  /// Groups to compute, of those of docs/metrics.md: these seven, and "soundness" where it is asked for.
  std::set<std::string> groups = {"skeleton", "transport", "skin", "surface", "image", "motion", "anymate"};

  /// Network and weights of LPIPS, and of the image encoder whose tokens are compared; null: not computed. They stand
  /// here so that no saved result outlives its weights.
  Json lpips, image_encoder;
  /// CategoryReferences::describe() of those that predictions are sorted by; null: not sorted. It stands here for the
  /// same reason.
  Json categories;

  /// MotionFile::described of the motion that every truth is given; null: each has its own. It stands here for the same
  /// reason.
  Json motion;

  bool wants(const std::string& group) const { return groups.count(group) > 0; }
};

Json to_json(const PairSettings& settings);

/// @throws InputError naming the option that is out of range, or an unknown group and those there are
void check(const PairSettings& settings);

/// Scores of one prediction against one ground truth. A metric either has a value or a reason why it has none.
struct PairResult {
  std::string id;
  std::string failure;                              ///< why nothing was computed at all; empty when something was
  std::map<std::string, double> values;             ///< key of metric_table() → finite value
  std::map<std::string, std::string> not_computed;  ///< key → reason
  std::vector<std::string> notes;                   ///< repairs of the inputs, starts chosen, anything worth knowing
  Json details = Json::object();                    ///< alignment, sizes, matching: what a reviewer may ask for
  std::string commit;  ///< of the program that computed it (core/version.h); empty where a saved result has none

  /// Sets a value; one that is not finite becomes a reason instead.
  void set(const std::string& key, double value);
  void skip(const std::string& key, const std::string& reason) { not_computed[key] = reason; }
  /// NaN when there is none.
  double value(const std::string& key) const;
};

Json to_json(const PairResult& result);
/// @throws InputError naming `file` when a field has another type
PairResult pair_result_from_json(const Json& json, const std::string& file);

/// Ground truth and prediction in the frame they are scored in.
struct ComparedShapes {
  io::RiggedShape predicted, truth;
  metrics::Alignment alignment;
  /// Visible parts of both meshes in that frame, where the settings ask for them.
  std::optional<Mesh> visible_predicted, visible_truth;
};

/// Category that the prediction should be recognised as, and its rivals.
struct CategoryQuestion {
  const CategoryReferences* references = nullptr;  ///< null: not asked
  std::string expected;                            ///< the truth's category; may be empty
  std::string truth_id;                            ///< no reference of this id may answer
};

/// Motion of both sides of a pair in the metric `motion_distance` and in pictures of it: the same frames.
struct MovedPair {
  metrics::Motion truth, predicted;
};

/// The truth's motion (truth_motion()) and, retargeted, the prediction's. @param given a motion for the truth in place
/// of its own; null: its own @pre both have joints @throws InputError as check()
MovedPair same_motion(const ComparedShapes& shapes, const PairSettings& settings, const metrics::Motion* given);

/// @throws InputError when the shapes have nothing to align by
ComparedShapes bring_together(const io::RiggedShape& predicted, const io::RiggedShape& truth,
                              const PairSettings& settings);

/// Every metric of metric_table() that the pair allows, each other one with its reason. Definitions: docs/metrics.md.
/// Runs on the calling thread; several pairs may be evaluated at once.
/// @param perceptual those that there are networks for
/// @param category for the metric of that name
/// @param motion as in same_motion(); settings.motion describes it
/// @throws InputError when nothing can be compared at all
PairResult evaluate_pair(const io::RiggedShape& predicted, const io::RiggedShape& truth, const PairSettings& settings,
                         const metrics::PerceptualDistances& perceptual = {}, const CategoryQuestion& category = {},
                         const metrics::Motion* motion = nullptr);

}  // namespace anigen::eval
