#include "anigen/rignet/model.h"

#include <algorithm>
#include <cmath>
#include <tuple>

#include "anigen/anymate/blocks.h"
#include "anigen/anymate/joints.h"
#include "anigen/rignet/skeleton.h"

namespace anigen::rignet {

VertexNetworkImpl::VertexNetworkImpl(const RignetOptions& options, std::int64_t channels) {
  const std::int64_t first = options.wide(64), second = options.wide(256), third = options.wide(512);
  const std::int64_t all = first + second + third, code = options.wide(1024), late = options.wide(256);
  units_ = register_module("units", GraphStack(std::vector<std::int64_t>{3, first, second, third}));
  whole_ = register_module("whole", DenseStack(std::vector<std::int64_t>{all, code}));
  head_ = register_module("head", DenseStack(std::vector<std::int64_t>{code + 3 + all, code, late}));
  dropout_ = register_module("dropout", torch::nn::Dropout(options.dropout));
  last_ = register_module("last", nn::Linear(late, channels));
}

Tensor VertexNetworkImpl::forward(const MeshGraph& graph) {
  const Tensor local = units_(graph.vertices, graph);
  const Tensor code = spread(run_maxima(whole_(local), graph.starts), graph.starts);
  return last_(dropout_(head_(torch::cat({code, graph.vertices, local}, 1))));
}

namespace {

Tensor distance_to_joints(const Tensor& points, const Tensor& joints) {
  return anymate::joint_chamfer_loss(points.unsqueeze(0), joints.unsqueeze(0), {joints.size(0)});
}

// Pairs i < j of [0, count), row by row. @return [2, P] int64
Tensor upper_pairs(std::int64_t count) { return torch::triu_indices(count, count, 1, torch::kInt64); }

using Widths = std::vector<std::int64_t>;

constexpr double kHardest = 0.3;
constexpr double kNoBone = -1e8, kLeastSum = 1e-10;

std::shared_ptr<torch::nn::Module> make_network(const RignetOptions& options) {
  switch (options.task) {
    case Task::kJoints:
      return std::make_shared<JointNetworkImpl>(options);
    case Task::kConnectivity:
      return std::make_shared<ConnectivityNetworkImpl>(options);
    case Task::kSkinning:
      return std::make_shared<SkinNetworkImpl>(options);
  }
  throw InputError("", "task", "is none of the known ones");
}

}  // namespace

JointNetworkImpl::JointNetworkImpl(const RignetOptions& options) : first_bandwidth_(options.bandwidth) {
  displace_ = register_module("displace", VertexNetwork(options, 3));
  attend_ = register_module("attend", VertexNetwork(options, 1));
  bandwidth_ = register_parameter("bandwidth", torch::empty({}));
}

void JointNetworkImpl::start() {
  displace_->zero_last();
  torch::nn::init::constant_(bandwidth_, first_bandwidth_);
}

DisplacedVertices JointNetworkImpl::forward(const MeshGraph& graph) {
  return {graph.vertices + torch::tanh(displace_(graph)), attend_(graph).squeeze(1)};
}

JointLosses joint_losses(const DisplacedVertices& displaced, const MeshGraph& graph, const std::vector<Tensor>& joints,
                         const Tensor& attention, const Tensor& bandwidth, std::int64_t shifts) {
  anymate::require(static_cast<std::int64_t>(joints.size()) == graph.meshes(), "joints", "must be given per mesh");
  anymate::require_shape(attention, {graph.vertices.size(0)}, "attention");
  const Tensor starts = graph.starts.cpu();
  const auto start = starts.accessor<std::int64_t, 1>();
  std::vector<Tensor> before, after;
  for (std::size_t b = 0; b < joints.size(); ++b) {
    const auto mesh = static_cast<std::int64_t>(b);
    const std::int64_t first = start[mesh], count = start[mesh + 1] - first;
    Tensor points = displaced.points.narrow(0, first, count);
    before.push_back(distance_to_joints(points, joints[b]));
    const Tensor attends = torch::sigmoid(displaced.attention_logits.narrow(0, first, count));
    for (std::int64_t i = 0; i < shifts; ++i) {
      points = mean_shifted(points, attends, bandwidth);
      after.push_back(distance_to_joints(points, joints[b]));
    }
  }
  JointLosses losses;
  losses.chamfer = torch::stack(before).mean();
  losses.attention = torch::binary_cross_entropy_with_logits(displaced.attention_logits, attention);
  if (!after.empty()) losses.clusters = torch::stack(after).mean();
  return losses;
}

SetAbstractionImpl::SetAbstractionImpl(double ratio, double radius, const std::vector<std::int64_t>& widths)
    : ratio_(ratio), radius_(radius) {
  mlp_ = register_module("mlp", DenseStack(widths));
}

SetAbstractionImpl::Result SetAbstractionImpl::forward(const PointSets& points, const Tensor& features) {
  const Balls balls = gather_balls(points, ratio_, radius_);
  Tensor seen = edge_sums(-balls.centres.positions, points.positions, balls.edges);
  if (features.defined()) seen = torch::cat({features.index_select(0, balls.edges.sources), seen}, 1);
  return {balls.centres, run_maxima(mlp_(seen), balls.edges.offsets)};
}

Tensor with_positions(const Tensor& features, const PointSets& points) {
  return torch::cat({features, points.positions}, 1);
}

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

RootNetworkImpl::RootNetworkImpl(const RignetOptions& options) {
  const auto wide = [&](std::int64_t published) { return options.wide(published); };
  const std::int64_t shape = wide(128), near = wide(128), far = wide(256), all = wide(512);
  shape_ = register_module("shape", ShapeCode(options, shape));
  near_ = register_module("near", SetAbstraction(0.999, 0.4, Widths{4, wide(64), wide(64), near}));
  far_ = register_module("far", SetAbstraction(0.33, 0.6, Widths{near + 3, wide(128), wide(128), far}));
  all_ = register_module("all", DenseStack(Widths{far + 3, wide(256), wide(256), all}));
  back_far_ = register_module("back_far", DenseStack(Widths{all + far, wide(256), wide(256)}));
  back_near_ = register_module("back_near", DenseStack(Widths{wide(256) + near, wide(256), wide(128)}));
  back_joints_ = register_module("back_joints", DenseStack(Widths{wide(128) + 1, wide(128), wide(128)}));
  head_ = register_module("head", DenseStack(Widths{shape + wide(128), wide(200), wide(64)}));
  last_ = register_module("last", nn::Linear(wide(64), 1));
}

Tensor RootNetworkImpl::forward(const ConnectivityInput& input) {
  const Tensor off_middle = input.joints.positions.narrow(1, 0, 1).abs();
  const SetAbstractionImpl::Result near = near_(input.joints, off_middle), far = far_(near.centres, near.features);
  const Tensor all = run_maxima(all_(with_positions(far.features, far.centres)), far.centres.starts);
  const Tensor at_far = back_far_(torch::cat({spread(all, far.centres.starts), far.features}, 1));
  const Tensor at_near = back_near_(torch::cat({interpolated(far.centres, at_far, near.centres), near.features}, 1));
  const Tensor at_joints = back_joints_(torch::cat({interpolated(near.centres, at_near, input.joints), off_middle}, 1));
  const Tensor shape = spread(shape_(input.graph), input.joints.starts);
  return last_(head_(torch::cat({shape, at_joints}, 1))).squeeze(1);
}

BoneNetworkImpl::BoneNetworkImpl(const RignetOptions& options) {
  const auto wide = [&](std::int64_t published) { return options.wide(published); };
  const std::int64_t shape = wide(64), joints = wide(128), pair = wide(256);
  shape_ = register_module("shape", ShapeCode(options, shape));
  near_ = register_module("near", SetAbstraction(0.999, 0.4, Widths{3, wide(64), wide(64), joints}));
  far_ = register_module("far", SetAbstraction(0.33, 0.6, Widths{joints + 3, wide(128), wide(128), wide(256)}));
  joints_ =
      register_module("joints", DenseStack(Widths{wide(256) + 3, wide(256), wide(256), wide(512), wide(256), joints}));
  pair_ = register_module("pair", DenseStack(Widths{8, wide(32), wide(64), wide(128), pair}));
  head_ = register_module("head", DenseStack(Widths{shape + joints + pair, wide(128), wide(64)}));
  dropout_ = register_module("dropout", torch::nn::Dropout(options.dropout));
  last_ = register_module("last", nn::Linear(wide(64), 1));
}

Tensor BoneNetworkImpl::judged(const Tensor& codes, const Tensor& from, const Tensor& to, const Tensor& inside) {
  const Tensor seen = torch::cat({from, to, (from - to).norm(2, 1, true), inside.unsqueeze(1)}, 1);
  return last_(dropout_(head_(torch::cat({codes, pair_(seen)}, 1)))).squeeze(1);
}

Tensor BoneNetworkImpl::forward(const ConnectivityInput& input) {
  if (input.first.size(0) == 0) return torch::zeros({0}, input.joints.positions.options());
  const SetAbstractionImpl::Result near = near_(input.joints, Tensor()), far = far_(near.centres, near.features);
  const Tensor joints = run_maxima(joints_(with_positions(far.features, far.centres)), far.centres.starts);
  const Tensor of_mesh = torch::cat({shape_(input.graph), joints}, 1);
  const Tensor mesh = run_of_rows(input.joints.starts).index_select(0, input.first);
  const Tensor codes = of_mesh.index_select(0, mesh);
  const Tensor a = input.joints.positions.index_select(0, input.first);
  const Tensor b = input.joints.positions.index_select(0, input.second);
  if (!is_training()) return 0.5 * (judged(codes, a, b, input.inside) + judged(codes, b, a, input.inside));
  const Tensor swap = (torch::rand({a.size(0), 1}) < 0.5).to(a.device());
  return judged(codes, torch::where(swap, b, a), torch::where(swap, a, b), input.inside);
}

ConnectivityNetworkImpl::ConnectivityNetworkImpl(const RignetOptions& options) {
  bone_ = register_module("bone", BoneNetwork(options));
  root_ = register_module("root", RootNetwork(options));
}

Tensor hard_binary_loss(const Tensor& logits, const Tensor& truth) {
  anymate::require_shape(logits, {-1}, "logits");
  anymate::require_shape(truth, {logits.size(0)}, "truth");
  anymate::require(logits.size(0) > 0, "logits", "there are none");
  const Tensor each = torch::binary_cross_entropy_with_logits(logits, truth, {}, {}, at::Reduction::None);
  const auto hard = static_cast<std::int64_t>(std::ceil(kHardest * static_cast<double>(each.size(0))));
  return each.mean() + std::get<0>(each.topk(std::max<std::int64_t>(hard, 1))).mean();
}

ConnectivityChances connectivity_chances(const ConnectivityLogits& logits, const ConnectivityInput& input) {
  anymate::require(input.graph.meshes() == 1, "input", "must be of one mesh");
  const torch::NoGradGuard no_grad;
  const std::int64_t joints = input.joints.positions.size(0);
  const Tensor first = input.first.cpu(), second = input.second.cpu();
  Tensor bone = torch::zeros({joints, joints});
  bone.index_put_({first, second}, torch::sigmoid(logits.bone).to(torch::kCPU, torch::kFloat32));
  return {bone + bone.t(), torch::sigmoid(logits.root).to(torch::kCPU, torch::kFloat32)};
}

SkinNetworkImpl::SkinNetworkImpl(const RignetOptions& options) : slots_(options.bones) {
  const auto wide = [&](std::int64_t published) { return options.wide(published); };
  const auto stack = [](std::vector<std::int64_t> widths) { return DenseStack(widths); };
  input_ = register_module("input", stack({3 + slots_ * kBoneNumbers, wide(128), wide(64)}));
  first_ = register_module("first", GraphUnit(wide(64), wide(512)));
  whole_ = register_module("whole", stack({wide(512), wide(512), wide(1024)}));
  second_ = register_module("second", GraphUnit(wide(512), wide(256)));
  third_ = register_module("third", GraphUnit(wide(256), wide(256)));
  head_ = register_module("head", stack({wide(1024) + wide(256), wide(1024), wide(512)}));
  last_ = register_module("last", nn::Linear(wide(512), slots_));
}

Tensor SkinNetworkImpl::forward(const MeshGraph& graph, const BoneSlots& slots) {
  anymate::require_shape(slots.bones, {graph.vertices.size(0), slots_}, "slots");
  anymate::require_shape(slots.features, {graph.vertices.size(0), slots_ * kBoneNumbers}, "features");
  const Tensor seen = first_(input_(torch::cat({graph.vertices, slots.features}, 1)), graph);
  const Tensor code = spread(run_maxima(whole_(seen), graph.starts), graph.starts);
  const Tensor local = third_(second_(seen, graph), graph);
  const Tensor logits = last_(head_(torch::cat({code, local}, 1)));
  return logits.masked_fill(slots.bones < 0, kNoBone);
}

Tensor skin_slot_loss(const Tensor& logits, const Tensor& weights) {
  anymate::require_shape(logits, {-1, -1}, "logits");
  anymate::require_shape(weights, logits.sizes().vec(), "weights");
  const Tensor sums = weights.sum(1, true);
  const Tensor counts = (sums > kLeastSum).to(logits.scalar_type());
  const Tensor truth = weights / sums.clamp_min(kLeastSum) * counts;
  return -(truth * torch::log_softmax(logits, 1)).sum() / counts.sum().clamp_min(1.0);
}

Tensor scattered_to_bones(const Tensor& shares, const Tensor& slots, std::int64_t bones) {
  anymate::require_shape(shares, slots.sizes().vec(), "shares");
  // An entry in no bone's slot goes to a column that is dropped.
  const Tensor columns = torch::where(slots < 0, torch::full_like(slots, bones), slots);
  return torch::zeros({shares.size(0), bones + 1}, shares.options())
      .scatter_add(1, columns, shares)
      .narrow(1, 0, bones);
}

Tensor cleaned_weights(const Tensor& weights, const EdgeSet& ring, double least) {
  anymate::require_shape(weights, {ring.targets(), -1}, "weights");
  const Tensor targets = run_of_rows(ring.offsets);
  const Tensor sums = torch::zeros_like(weights).index_add(0, targets, weights.index_select(0, ring.sources)) - weights;
  const Tensor neighbours = (ring.offsets.diff() - 1).unsqueeze(1);
  Tensor rows = torch::where(neighbours > 0, sums / neighbours.clamp_min(1), weights);
  rows = rows.clamp_min(0.0);  // differences of sums may come out just below
  rows = rows.masked_fill(rows < least * rows.amax(1, true), 0.0);
  return rows / rows.sum(1, true).clamp_min(kLeastSum);
}

RignetModelImpl::RignetModelImpl(const RignetOptions& options, nn::Init init) : options_(options) {
  network_ = register_module(name_of(options.task), make_network(options));
  if (init == nn::Init::kNone) return;
  anymate::default_layers(*network_);
  if (options.task == Task::kJoints) network<JointNetworkImpl>().start();
}

}  // namespace anigen::rignet
