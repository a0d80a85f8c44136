#include "anigen/models/rignet/connectivity_input.h"

#include "anigen/models/anymate/checks.h"

namespace anigen::models::rignet {
namespace {

// Pairs i < j of [0, count), row by row. @return [2, P] int64
Tensor upper_pairs(std::int64_t count) { return torch::triu_indices(count, count, 1, torch::kInt64); }

}  // namespace

ConnectivityInput connectivity_input(const std::vector<MeshGraph>& graphs, const std::vector<Tensor>& joints,
                                     const std::vector<Tensor>& inside, torch::Device device) {
  anymate::require(graphs.size() == joints.size() && joints.size() == inside.size(), "joints",
                   "must be given per mesh");
  std::vector<std::int64_t> counts;
  std::vector<Tensor> pairs, shares;
  std::int64_t before = 0;
  for (std::size_t b = 0; b < joints.size(); ++b) {
    anymate::require_shape(joints[b], {-1, 3}, "joints");
    const std::int64_t count = joints[b].size(0);
    anymate::require_shape(inside[b], {count, count}, "inside");
    const Tensor pair = upper_pairs(count);
    counts.push_back(count);
    shares.push_back(inside[b].index({pair[0], pair[1]}));
    pairs.push_back(pair + before);
    before += count;
  }
  ConnectivityInput input;
  input.graph = joined(graphs).to(device);
  input.joints = PointSets{torch::cat(joints), starts_of(counts)}.to(device);
  const Tensor rows = torch::cat(pairs, 1).to(device);
  input.first = rows[0];
  input.second = rows[1];
  input.inside = torch::cat(shares).to(device, torch::kFloat32);
  return input;
}

ConnectivityTruth connectivity_truth(const std::vector<Tensor>& parents, torch::Device device) {
  std::vector<Tensor> bone, root;
  for (const Tensor& parent : parents) {
    anymate::require_shape(parent, {-1}, "parents");
    const Tensor all = parent.to(torch::kInt64), pair = upper_pairs(all.size(0));
    bone.push_back((all.index_select(0, pair[0]) == pair[1]) | (all.index_select(0, pair[1]) == pair[0]));
    root.push_back(all == torch::arange(all.size(0)));
  }
  return {torch::cat(bone).to(device, torch::kFloat32), torch::cat(root).to(device, torch::kFloat32)};
}

}  // namespace anigen::models::rignet
