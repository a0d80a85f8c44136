#pragma once
#include <cstdint>
#include <string>
#include <vector>

#include "anigen/core/config_fields.h"
#include "anigen/nn/linear.h"
#include "anigen/nn/torch.h"

namespace anigen::rignet {

using torch::Tensor;

/// Directed edges sorted by the point they lead to: into target i come those from sources[offsets[i]] to
/// sources[offsets[i + 1] - 1]. Every target has at least one. Targets and sources may be points of two sets.
struct EdgeSet {
  Tensor offsets;  ///< [V + 1] int64, strictly ascending from 0
  Tensor sources;  ///< [E] int64

  std::int64_t targets() const { return offsets.size(0) - 1; }
  std::int64_t size() const { return sources.size(0); }
  EdgeSet to(torch::Device device) const { return {offsets.to(device), sources.to(device)}; }
};

/// For rows in consecutive runs, the run of each. @param offsets [S + 1] int64 ascending from 0 @return [rows] int64
Tensor run_of_rows(const Tensor& offsets);

/// at_target[target of e] + at_source[source of e], the start of a message. On the CPU by hand, since LibTorch 1.13
/// adds gradients of gathered rows one by one.
/// @param at_target [V, C] @param at_source [S, C] floating @return [E, C] @throws InputError for shapes
Tensor edge_sums(const Tensor& at_target, const Tensor& at_source, const EdgeSet& edges);

/// Largest value of each run in each channel; of equal ones the first takes the gradient, and NaN is the largest.
/// @param values [E, C] floating @param offsets [S + 1] int64, strictly ascending from 0 to E @return [S, C]
/// @throws InputError for shapes or an empty run
Tensor run_maxima(const Tensor& values, const Tensor& offsets);

/// Both sums by LibTorch's own operators, which other devices use; equal values share the gradient.
Tensor indexed_edge_sums(const Tensor& at_target, const Tensor& at_source, const EdgeSet& edges);
Tensor scattered_maxima(const Tensor& values, const Tensor& offsets);

/// Meshes as RigNet's networks see them, one after another in the same rows, so that meshes of any size form a batch.
/// Frame: longest side 1, Y up, x and z centred, lowest y 0 (docs/reference/rignet.md, 1).
struct MeshGraph {
  Tensor vertices;  ///< [V, 3] fp32
  EdgeSet ring;     ///< from the vertices that share an edge with each, and from itself
  EdgeSet ball;     ///< from some of those within a geodesic ball around each, and from itself
  Tensor starts;    ///< [B + 1] int64: rows starts[b] to starts[b + 1] - 1 are mesh b

  std::int64_t meshes() const { return starts.size(0) - 1; }
  MeshGraph to(torch::Device device) const {
    return {vertices.to(device), ring.to(device), ball.to(device), starts.to(device)};
  }
};

/// Joins meshes into one batch. @param graphs at least one, on the same device
MeshGraph joined(const std::vector<MeshGraph>& graphs);

/// [B + 1] int64 from the number of rows of each item, on the CPU.
Tensor starts_of(const std::vector<std::int64_t>& counts);

/// One row per item as one row per row of the items. @param rows [B, C] @param starts [B + 1] @return [starts[B], C]
Tensor spread(const Tensor& rows, const Tensor& starts);

/// Joints of several meshes in the same rows.
struct PointSets {
  Tensor positions;  ///< [N, 3] fp32
  Tensor starts;     ///< [B + 1] int64: rows starts[b] to starts[b + 1] - 1 belong to mesh b; none is empty

  PointSets to(torch::Device device) const { return {positions.to(device), starts.to(device)}; }
};

/// Some of the points as centres, and edges to each from the points around it (Qi et al. 2017, PointNet++).
struct Balls {
  PointSets centres;
  EdgeSet edges;  ///< from points to centres
};

/// Centres by farthest-point sampling, ceil(ratio · N) of each set, beginning with the point farthest from the set's
/// mean, so that neither chance nor the order of points decides; and all points within `radius` of each, the nearest
/// `most` of them. @return on the device of the points @throws InputError for shapes or an empty set
Balls gather_balls(const PointSets& points, double ratio, double radius, std::int64_t most = 64);

/// Values of coarse points at fine ones: means of the three nearest of the same set, weighted by inverse squared
/// distances; fewer where there are fewer. @param values [M, C] @return [N, C] @throws InputError for shapes
Tensor interpolated(const PointSets& coarse, const Tensor& values, const PointSets& fine);

/// Batch norm over rows (momentum 0.1). A single row has no spread to divide by: it is normed as in evaluation.
/// @param x [N, C]
Tensor batch_normed(torch::nn::BatchNorm1d& norm, const Tensor& x);

/// Layer of RigNet's perceptrons: Linear, ReLU, batch norm (docs/reference/rignet.md, 2). Keys `linear.*`, `norm.*`.
class ReluNormImpl : public torch::nn::Module {
 public:
  ReluNormImpl(std::int64_t in, std::int64_t out);
  Tensor forward(const Tensor& x);  ///< @param x [N, in] @return [N, out]

 private:
  nn::Linear linear_ = nullptr;
  torch::nn::BatchNorm1d norm_ = nullptr;
};
TORCH_MODULE(ReluNorm);

/// Such layers after each other. Keys `0.*`, `1.*`, …
class DenseStackImpl : public torch::nn::Module {
 public:
  /// @param widths of the input, then of each layer's output
  explicit DenseStackImpl(const std::vector<std::int64_t>& widths);
  Tensor forward(Tensor x);  ///< @param x [N, first width] @return [N, last width]

 private:
  std::vector<ReluNorm> layers_;
};
TORCH_MODULE(DenseStack);

/// Aggregation at each point along its edges: the largest, channel by channel, of MLP([x_i, x_j − x_i]) over the edges
/// from j to i, the MLP being two layers of out channels (docs/reference/rignet.md, 2). The first layer is linear in
/// both halves, so it is computed once per point and added per edge. Keys `first.*`, `norm.*`, `second.*`.
class EdgeMessageImpl : public torch::nn::Module {
 public:
  EdgeMessageImpl(std::int64_t in, std::int64_t out);
  Tensor forward(const Tensor& x, const EdgeSet& edges);  ///< @param x [V, in] @return [V, out]

 private:
  std::int64_t in_;
  nn::Linear first_ = nullptr;
  torch::nn::BatchNorm1d norm_ = nullptr;
  ReluNorm second_ = nullptr;
};
TORCH_MODULE(EdgeMessage);

/// GMEdgeConv: messages of half the channels along either edges, through one layer. Keys `ring.*`, `ball.*`, `mix.*`.
class GraphUnitImpl : public torch::nn::Module {
 public:
  GraphUnitImpl(std::int64_t in, std::int64_t out);         ///< @throws InputError unless out is even
  Tensor forward(const Tensor& x, const MeshGraph& graph);  ///< @param x [V, in] @return [V, out]

 private:
  EdgeMessage ring_ = nullptr, ball_ = nullptr;
  ReluNorm mix_ = nullptr;
};
TORCH_MODULE(GraphUnit);

/// Units after each other, what all of them give side by side. Keys `0.*`, `1.*`, …
class GraphStackImpl : public torch::nn::Module {
 public:
  explicit GraphStackImpl(const std::vector<std::int64_t>& widths);  ///< of the input, then of each unit
  Tensor forward(Tensor x, const MeshGraph& graph);                  ///< @return [V, sum of the units' widths]

 private:
  std::vector<GraphUnit> units_;
};
TORCH_MODULE(GraphStack);

/// Task of one model of RigNet; the published system trains one after the other.
enum class Task {
  kJoints,        ///< JointNet, MaskNet and the bandwidth of their clustering
  kConnectivity,  ///< BoneNet and RootNet
  kSkinning       ///< SkinNet
};

/// joints, connectivity, skin.
const std::vector<std::string>& task_names();
const std::string& name_of(Task task);

/// A model of RigNet (Xu et al. 2020; docs/reference/rignet.md, 2). Defaults are published.
struct RignetOptions : JsonOptions<RignetOptions> {
  Task task = Task::kJoints;
  double width = 1.0;         ///< factor on every published layer width, for small models (ours)
  double dropout = 0.7;       ///< before the last layer of joints, attention and bones
  double bandwidth = 0.04;    ///< that mean shift starts from, in units of the longest side
  std::int64_t bones = 5;     ///< nearest ones that skinning weighs at a vertex
  bool mirrored = true;       ///< joints are predicted symmetric about x = 0
  double least_weight = 0.5;  ///< share of a vertex's largest weight that others must reach; the published demo: 0.35

  /// A published width times `width`, even, at least 8.
  std::int64_t wide(std::int64_t published) const;

  void fields(ConfigFields& f);
};

/// One code per mesh, as BoneNet and RootNet look at it: units of 64, 128 and 256, their outputs through 256 and a last
/// width, the largest over vertices (docs/reference/rignet.md, 4). Keys `units.*`, `whole.*`.
class ShapeCodeImpl : public torch::nn::Module {
 public:
  ShapeCodeImpl(const RignetOptions& options, std::int64_t width);  ///< @param width of the code
  Tensor forward(const MeshGraph& graph);                           ///< @return [B, width]

 private:
  GraphStack units_ = nullptr;
  DenseStack whole_ = nullptr;
};
TORCH_MODULE(ShapeCode);

}  // namespace anigen::rignet
