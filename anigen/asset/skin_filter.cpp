#include "anigen/asset/skin_filter.h"

#include <algorithm>
#include <string>

#include "anigen/core/error.h"
#include "anigen/core/numeric.h"

namespace anigen {
namespace {

constexpr double kSmallestSum = 1e-8;

void check_joint(int joint, std::size_t joints, std::size_t vertex) {
  if (joint >= 0 && at(joint) < joints) return;
  throw InputError("", "skin row " + std::to_string(vertex),
                   "joint " + std::to_string(joint) + " is not one of the " + std::to_string(joints) + " joints");
}

}  // namespace

int published_max_hops(std::size_t joints) { return 2 * std::max(1, static_cast<int>(joints / 10)); }

SkinWeights filter_skin(const SkinWeights& skin, const std::vector<std::vector<int>>& hops, int max_hops,
                        const std::vector<int>& anchors) {
  const std::size_t joints = hops.size();
  if (joints == 0) throw InputError("", "hops", "there are no joints");
  for (const std::vector<int>& row : hops) {
    if (row.size() != joints) throw InputError("", "hops", "must have as many columns as rows");
  }
  if (!anchors.empty() && anchors.size() != skin.rows()) {
    throw InputError("", "anchors",
                     std::to_string(anchors.size()) + " anchors for " + std::to_string(skin.rows()) + " vertices");
  }
  SkinWeights filtered;
  filtered.offsets.reserve(skin.rows() + 1);
  for (std::size_t v = 0; v < skin.rows(); ++v) {
    const Influence* row = skin.row(v);
    // Rows begin with their heaviest influence.
    const int heaviest = skin.row_size(v) > 0 ? row[0].joint : 0;
    const int anchor = anchors.empty() ? heaviest : anchors[v];
    check_joint(anchor, joints, v);
    std::vector<Influence> kept;
    double sum = 0.0;
    for (std::size_t i = 0; i < skin.row_size(v); ++i) {
      check_joint(row[i].joint, joints, v);
      if (hops[at(anchor)][at(row[i].joint)] > max_hops) continue;
      kept.push_back(row[i]);
      sum += row[i].weight;
    }
    if (!(sum > kSmallestSum)) kept.assign(1, {anchor, 1.0f});
    filtered.append_row(std::move(kept));
  }
  return filtered;
}

}  // namespace anigen
