#include "anigen/loaders/skin_sampler.h"

#include <algorithm>
#include <cmath>

#include "anigen/geometry/surface_sampling.h"

namespace anigen::loaders {
namespace {

// 1 − the largest weight at the middle of the face; `scratch` [joints] is zero before and after.
double blend_of(const RiggedItem& item, const Triangle& face, std::vector<float>& scratch) {
  float largest = 0.0f;
  for (const std::int32_t vertex : face) {
    const Influence* row = item.skin.row(static_cast<std::size_t>(vertex));
    for (std::size_t i = 0; i < item.skin.row_size(static_cast<std::size_t>(vertex)); ++i) {
      largest = std::max(largest, scratch[static_cast<std::size_t>(row[i].joint)] += row[i].weight);
    }
  }
  for (const std::int32_t vertex : face) {
    const Influence* row = item.skin.row(static_cast<std::size_t>(vertex));
    for (std::size_t i = 0; i < item.skin.row_size(static_cast<std::size_t>(vertex)); ++i) {
      scratch[static_cast<std::size_t>(row[i].joint)] = 0.0f;
    }
  }
  // Rounding leaves about 1e-7 of blend on a rigid face.
  const double blend = 1.0 - largest / 3.0;
  return blend > 1e-5 ? blend : 0.0;
}

bool accumulate_and_normalize(std::vector<double>& values) {
  double sum = 0.0;
  for (double& value : values) value = sum += value;
  if (!(sum > 0.0)) return false;
  for (double& value : values) value /= sum;
  return true;
}

}  // namespace

SkinSampler::SkinSampler(const RiggedItem& item, bool with_blends)
    : areas_(geometry::face_probabilities(item.vertices, item.faces)) {
  if (with_blends) {
    std::vector<float> scratch(item.joints.size(), 0.0f);
    blends_.resize(areas_.size());
    for (std::size_t f = 0; f < areas_.size(); ++f) blends_[f] = areas_[f] * blend_of(item, item.faces[f], scratch);
    if (!accumulate_and_normalize(blends_)) blends_.clear();
  }
  accumulate_and_normalize(areas_);
}

geometry::SurfacePoint SkinSampler::draw(double blend_share, Rng& rng) const {
  const double which = rng.uniform(), place = rng.uniform(), u = rng.uniform(), v = rng.uniform();
  const std::vector<double>& sums = which < blend_share && !blends_.empty() ? blends_ : areas_;
  const auto found = std::upper_bound(sums.begin(), sums.end(), place);
  const double root = std::sqrt(u);
  geometry::SurfacePoint point;
  point.face = static_cast<std::int32_t>(
      std::min<std::ptrdiff_t>(found - sums.begin(), static_cast<std::ptrdiff_t>(sums.size()) - 1));
  point.barycentric = {1.0 - root, root * (1.0 - v), root * v};
  return point;
}

void add_weights_at(const RiggedItem& item, const geometry::SurfacePoint& point, const std::vector<int>& joint_of,
                    float* out) {
  const Triangle& face = item.faces[static_cast<std::size_t>(point.face)];
  for (int corner = 0; corner < 3; ++corner) {
    const auto vertex = static_cast<std::size_t>(face[static_cast<std::size_t>(corner)]);
    const auto share = static_cast<float>(point.barycentric[corner]);
    const Influence* row = item.skin.row(vertex);
    for (std::size_t i = 0; i < item.skin.row_size(vertex); ++i) {
      out[joint_of[static_cast<std::size_t>(row[i].joint)]] += share * row[i].weight;
    }
  }
}

}  // namespace anigen::loaders
