#include "anigen/skin_correction/weights.h"

#include <algorithm>
#include <numeric>
#include <utility>
#include <vector>

#include "anigen/core/error.h"
#include "anigen/core/numeric.h"
#include "anigen/core/parallel.h"
#include "anigen/core/process.h"

namespace anigen::skin_correction {

namespace {

constexpr std::size_t kPlacesAtOnce = 4096;
constexpr float kLeastWeight = 1e-4F;  // a softmax is nowhere zero

using Row = std::vector<Influence>;

Row row_of(const std::int32_t* joints, const float* weights, std::size_t count) {
  Row row;
  for (std::size_t c = 0; c < count; ++c) {
    if (joints[c] >= 0 && weights[c] >= kLeastWeight) row.push_back({joints[c], weights[c]});
  }
  return row;
}

// The network's rows of all places.
std::vector<Row> rows_by_network(SkinCorrection& network, const rigging::SkinFeatures& features) {
  std::vector<Row> rows(features.places());
  const std::size_t count = features.candidates();
  for (std::size_t first = 0; first < rows.size(); first += kPlacesAtOnce) {
    throw_if_interrupted();
    std::vector<std::int32_t> places(std::min(kPlacesAtOnce, rows.size() - first));
    std::iota(places.begin(), places.end(), static_cast<std::int32_t>(first));
    const rigging::SkinPairs pairs = features.pairs(places);
    const PairTensors in = pair_tensors(features, pairs);
    const Tensor weights = network->forward(in.pairs, in.assets, in.present).exp().contiguous();
    if (!weights.isfinite().all().item<bool>())
      throw InputError("", "", "the network gives weights that are not finite");
    const float* of_place = weights.data_ptr<float>();
    for (std::size_t i = 0; i < places.size(); ++i)
      rows[first + i] = row_of(&pairs.joints[i * count], of_place + i * count, count);
  }
  return rows;
}

// (1 − s) w + s · the mean over the neighbours; a place without any keeps its weights.
std::vector<Row> smoothed(const std::vector<Row>& rows, const rigging::SkinFeatures& features, double share) {
  std::vector<Row> result(rows.size());
  parallel_for(rows.size(), [&](std::size_t p) {
    const std::int32_t *first = features.neighbors_begin(p), *last = features.neighbors_end(p);
    result[p] = rows[p];
    if (first == last) return;
    const auto each = static_cast<float>(share / static_cast<double>(last - first));
    for (Influence& own : result[p]) own.weight *= static_cast<float>(1.0 - share);
    for (const std::int32_t* neighbor = first; neighbor != last; ++neighbor) {
      for (const Influence& other : rows[at(*neighbor)]) result[p].push_back({other.joint, each * other.weight});
    }
  });
  return result;
}

}  // namespace

PairTensors pair_tensors(const rigging::SkinFeatures& features, const rigging::SkinPairs& pairs) {
  const auto count = static_cast<std::int64_t>(features.candidates());
  const auto rows = static_cast<std::int64_t>(pairs.joints.size()) / count;
  PairTensors tensors;
  tensors.pairs = torch::empty({rows, count, static_cast<std::int64_t>(rigging::kSkinPairFeatures)});
  std::copy(pairs.features.begin(), pairs.features.end(), tensors.pairs.data_ptr<float>());
  tensors.present = torch::empty({rows, count}, torch::kBool);
  std::transform(pairs.joints.begin(), pairs.joints.end(), tensors.present.data_ptr<bool>(),
                 [](std::int32_t joint) { return joint >= 0; });
  const auto& asset = features.asset();
  tensors.assets = torch::tensor(std::vector<float>(asset.begin(), asset.end())).expand({rows, -1});
  return tensors;
}

SkinWeights corrected_weights(SkinCorrection& network, const rigging::SkinFeatures& features,
                              std::size_t most_influences, double smoothing) {
  const torch::NoGradGuard no_grad;
  if (features.candidates() != network->options().features().candidates)
    throw InputError("", "candidates", "the features have another number of candidates than the network");
  std::vector<Row> rows = rows_by_network(network, features);
  if (smoothing > 0.0) rows = smoothed(rows, features, smoothing);
  SkinWeights of_places, skin;
  for (Row& row : rows) of_places.append_row(std::move(row));
  for (const std::int32_t place : features.place_of_vertex()) skin.append_copy(of_places, at(place));
  return most_influences == 0 ? skin : limit_influences(skin, most_influences);
}

}  // namespace anigen::skin_correction
