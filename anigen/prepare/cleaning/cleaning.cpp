#include "anigen/prepare/cleaning/cleaning.h"

#include <cstdio>
#include <optional>
#include <utility>

#include "anigen/prepare/cleaning/joint_rules.h"
#include "anigen/prepare/skeleton_checks.h"

namespace anigen::prepare {
namespace {

std::string three_digits(double value) {
  char text[32];
  std::snprintf(text, sizeof text, "%.3g", value);
  return text;
}

/// Empty when the count is allowed.
std::string broken_range(const std::string& what, std::size_t count, const CountRange& range) {
  if (range.holds(count)) return "";
  const bool few = count < range.least;
  return std::to_string(count) + " " + what + ", " + (few ? "at least " : "at most ") +
         std::to_string(few ? range.least : range.most);
}

}  // namespace

Json to_json(const CleaningFinding& finding) {
  return {{"rule", finding.rule}, {"action", finding.action}, {"detail", finding.detail}};
}

CleaningFinding cleaning_finding_from_json(const Json& json) {
  CleaningFinding finding;
  json.at("rule").get_to(finding.rule);
  json.at("action").get_to(finding.action);
  json.at("detail").get_to(finding.detail);
  return finding;
}

CleanedOut::CleanedOut(const std::string& file, CleaningFinding finding)
    : InputError(file, finding.rule, finding.detail), finding_(std::move(finding)) {}

std::vector<CleaningFinding> clean(Asset& asset, const ReadQuality& quality, const CleaningOptions& options,
                                   const std::string& file) {
  std::vector<CleaningFinding> findings;
  const auto keep = [&findings](std::optional<CleaningFinding> finding) {
    if (finding) findings.push_back(std::move(*finding));
  };
  const auto drop_when = [&file](bool broken, const std::string& rule, const std::string& detail) {
    if (broken) throw CleanedOut(file, {rule, "dropped", detail});
  };
  drop_when(options.drop_duplicate_names && quality.repeated_names > 0, "duplicate_joint_names",
            std::to_string(quality.repeated_names) + " joints have a name that another joint has");
  drop_when(quality.lowest_weight_sum < options.least_weight_sum, "low_weight_sum",
            "the weights of a vertex sum to " + three_digits(quality.lowest_weight_sum) + ", at least " +
                three_digits(options.least_weight_sum));
  if (options.duplicate_joints == DuplicateJoints::kMerge) keep(merge_duplicate_joints(asset, options.merge_distance));
  keep(prune_unused_joints(asset, options.unused_joints));
  const std::string vertices = broken_range("vertices", asset.mesh.vertices.size(), options.vertices);
  drop_when(!vertices.empty(), "vertex_count", vertices);
  const std::string joints = broken_range("joints", asset.skeleton.size(), options.joints);
  drop_when(!joints.empty(), "joint_count", joints);
  const double outside = outside_share(asset.skeleton.positions(), bounding_box(asset.mesh.vertices));
  drop_when(outside > options.max_outside_share, "outside_mesh",
            three_digits(100 * outside) + " % of the joints lie outside the mesh, at most " +
                three_digits(100 * options.max_outside_share) + " %");
  return findings;
}

void count(const std::vector<CleaningFinding>& findings, CleaningCounts& counts) {
  for (const CleaningFinding& finding : findings) ++counts[finding.rule][finding.action];
}

}  // namespace anigen::prepare
