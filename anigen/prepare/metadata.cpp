#include "anigen/prepare/metadata.h"

#include <algorithm>
#include <cmath>
#include <map>
#include <sstream>
#include <utility>

#include "anigen/asset/mesh.h"
#include "anigen/core/error.h"
#include "anigen/core/numeric.h"
#include "anigen/core/random.h"
#include "anigen/core/text.h"

namespace anigen::prepare {

namespace {

/// True when every joint of `a` has one of its depth in `b` within `limit`.
bool covered(const SkeletonDescriptor& a, const SkeletonDescriptor& b, double limit) {
  for (std::size_t i = 0; i < a.joints(); ++i) {
    bool found = false;
    for (std::size_t k = 0; k < b.joints() && !found; ++k) {
      if (a.depths[i] != b.depths[k]) continue;
      double square = 0.0;
      for (std::size_t axis = 0; axis < 3; ++axis) {
        const double difference = static_cast<double>(a.places[3 * i + axis]) - b.places[3 * k + axis];
        square += difference * difference;
      }
      found = square <= limit * limit;
    }
    if (!found) return false;
  }
  return true;
}

std::vector<std::int32_t> numbers(const Json& json, const std::string& key) {
  std::istringstream text(json.at(key).get<std::string>());
  std::vector<std::int32_t> values;
  for (std::int32_t value = 0; text >> value;) values.push_back(value);
  if (!text.eof()) throw InputError("", "/" + key, "expected whole numbers with blanks between them");
  return values;
}

// Twice the tolerance: both ends of a bone may move.
double length_reach(double tolerance) { return 2.0 * tolerance + 1e-9; }

}  // namespace

SkeletonDescriptor describe(const Skeleton& skeleton) {
  SkeletonDescriptor result;
  result.topology = tree_signature(skeleton.parents);
  const std::vector<Eigen::Vector3d> positions = skeleton.positions();
  Box box;
  for (const Eigen::Vector3d& p : positions) box.extend(p);
  const double side = box.longest_side();
  const double scale = side > 0.0 ? SkeletonDescriptor::kPlaces / side : 0.0;
  std::vector<Eigen::Vector3d> rounded;
  for (std::size_t j = 0; j < positions.size(); ++j) {
    const Eigen::Vector3d p = (scale * (positions[j] - box.center())).array().round();
    rounded.push_back(p);
    for (const double x : p) result.places.push_back(static_cast<std::int32_t>(x));
    const int parent = skeleton.parents[j];
    result.depths.push_back(parent < 0 ? 0 : result.depths[at(parent)] + 1);
    if (parent >= 0) result.length += (p - rounded[at(parent)]).norm();
  }
  if (positions.size() > 1) result.length /= SkeletonDescriptor::kPlaces * static_cast<double>(positions.size() - 1);
  return result;
}

void to_json(Json& json, const SkeletonDescriptor& descriptor) {
  // One string instead of an array, which indented JSON would spread over thousands of lines.
  json = {{"topology", descriptor.topology},
          {"length", descriptor.length},
          {"places", joined(descriptor.places, " ")},
          {"depths", joined(descriptor.depths, " ")}};
}

void from_json(const Json& json, SkeletonDescriptor& descriptor) {
  json.at("topology").get_to(descriptor.topology);
  json.at("length").get_to(descriptor.length);
  descriptor.places = numbers(json, "places");
  descriptor.depths = numbers(json, "depths");
  if (descriptor.places.size() != 3 * descriptor.depths.size())
    throw InputError("", "/places",
                     "three numbers for each of " + std::to_string(descriptor.depths.size()) + " depths");
}

bool near(const SkeletonDescriptor& a, const SkeletonDescriptor& b, double tolerance) {
  if (a.topology != b.topology || a.joints() != b.joints()) return false;
  if (std::abs(a.length - b.length) > length_reach(tolerance)) return false;
  const double limit = tolerance * SkeletonDescriptor::kPlaces;
  return covered(a, b, limit) && covered(b, a, limit);
}

std::vector<std::optional<std::size_t>> near_duplicates(const std::vector<SkeletonDescriptor>& descriptors,
                                                        double tolerance, std::size_t least_joints) {
  std::vector<std::optional<std::size_t>> result(descriptors.size());
  // Of each kind of tree, those near to none so far, by mean bone length.
  std::map<std::string, std::multimap<double, std::size_t>> kept;
  for (std::size_t i = 0; i < descriptors.size(); ++i) {
    const SkeletonDescriptor& one = descriptors[i];
    if (one.joints() < least_joints) continue;
    std::multimap<double, std::size_t>& alike = kept[one.topology];
    const double reach = length_reach(tolerance);
    for (auto other = alike.lower_bound(one.length - reach); other != alike.end() && other->first <= one.length + reach;
         ++other) {
      const bool earlier = !result[i] || other->second < *result[i];
      if (earlier && near(one, descriptors[other->second], tolerance)) result[i] = other->second;
    }
    if (!result[i]) alike.emplace(one.length, i);
  }
  return result;
}

bool distinct_bones(const AssetRecord& record, const QualityLimits& limits) {
  return record.closest_bones > limits.same_bone;
}

bool usable(const AssetRecord& record, const QualityLimits& limits) {
  return distinct_bones(record, limits) && record.num_joints >= limits.min_joints &&
         record.num_joints <= limits.max_joints && record.outside_share <= limits.max_outside_share;
}

bool bad_skin(const AssetRecord& record, const QualityLimits& limits) {
  return record.lowest_weight_sum < limits.least_weight_sum ||
         static_cast<double>(record.invented_rows) >
             limits.max_invented_rows * static_cast<double>(record.num_vertices);
}

std::vector<bool> choose_test(const std::vector<std::string>& ids, std::size_t count, std::uint64_t seed) {
  std::vector<std::pair<std::uint64_t, std::size_t>> ranked;
  for (std::size_t i = 0; i < ids.size(); ++i) ranked.emplace_back(stable_hash("split/" + ids[i], seed), i);
  std::sort(ranked.begin(), ranked.end(), [&](const auto& a, const auto& b) {
    return a.first != b.first ? a.first < b.first : ids[a.second] < ids[b.second];
  });
  std::vector<bool> test(ids.size(), false);
  for (std::size_t i = 0; i < std::min(count, ranked.size()); ++i) test[ranked[i].second] = true;
  return test;
}

std::size_t test_count(std::size_t n, double fraction) {
  if (!(fraction >= 0.0 && fraction <= 1.0))
    throw InputError("", "--test-fraction", "must lie in [0, 1], got " + std::to_string(fraction));
  return static_cast<std::size_t>(std::lround(fraction * static_cast<double>(n)));
}

}  // namespace anigen::prepare
