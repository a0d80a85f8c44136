#pragma once
#include <cstddef>
#include <cstdint>
#include <filesystem>
#include <map>
#include <string>
#include <vector>

#include "anigen/asset/rigged_asset.h"
#include "anigen/core/job.h"

namespace anigen::engine {

struct EvaluateOptions {
  /// skeleton, transport, skin, surface, image, motion, anymate, soundness; empty: all but soundness.
  std::vector<std::string> groups;
  std::string protocol;  ///< of another paper: anigen, magicarticulate, …, which fixes groups and frame; empty: none
  std::string normalization = "centroid-rms";  ///< or bounding-box, truth, truth-with-joints, none
  bool registration = true;                    ///< the prediction is registered to the truth by ICP
  double merge_joints = 0.0;                   ///< joints nearer than this are one, in the frame of scores; 0: none
  bool visible_surface = false;
  std::size_t surface_samples = 100'000;
  std::uint64_t seed = 0;
};

/// Metrics of one prediction, by the keys of docs/metrics.md. Each has a value or a reason why it has none.
struct Scores {
  std::map<std::string, double> values;
  std::map<std::string, std::string> not_computed;
  std::vector<std::string> notes;
};

/// Compares a prediction with its ground truth: the numbers of anigen-eval for the same files.
/// @throws InputError for an unknown word, or when the two share nothing that can be compared; Interrupted
Scores evaluate(const Asset& predicted, const Asset& truth, const EvaluateOptions& options = {}, Job* job = nullptr);

/// Gromov–Wasserstein distance of two skeletons by distances along their bones, as the column gromov_wasserstein
/// (docs/metrics.md), in the unit of the skeletons.
double gromov_wasserstein(const JointTree& predicted, const JointTree& truth);
/// Wasserstein distance of their joints, as the column wasserstein.
double wasserstein(const JointTree& predicted, const JointTree& truth);

struct Chamfer {
  double j2j = 0.0, j2b = 0.0, b2b = 0.0;  ///< joints to joints, joints to bones, bones to bones; both ways, mean
};
Chamfer chamfer(const JointTree& predicted, const JointTree& truth);

/// One thing wrong with a rig; docs/lint.md lists the codes.
struct Finding {
  std::string code;      ///< "unweighted-vertices"
  std::string severity;  ///< note, warning, error
  std::string sentence;
  std::size_t count = 0;   ///< vertices, joints or faces concerned
  double share = 0.0;      ///< of all of that kind, 0 … 1
  std::string place_kind;  ///< of the worst spot: vertex, joint, face; empty: none
  std::size_t place = 0;
};

/// Finds what is wrong with a rig, the gravest first. An asset does not know what load() repaired: for a file see
/// lint_file(). @throws Interrupted
std::vector<Finding> lint(const Asset& asset, Job* job = nullptr);

/// Finds what is wrong with the rig of a file, repairs of its importer included, as `anigen-inspect --lint`.
/// @throws InputError for a file that cannot be read, or one of several rigs; Interrupted
std::vector<Finding> lint_file(const std::filesystem::path& file, Job* job = nullptr);

}  // namespace anigen::engine
