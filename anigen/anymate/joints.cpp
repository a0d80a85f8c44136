#include "anigen/anymate/joints.h"

#include <Eigen/Core>
#include <algorithm>
#include <cstdint>
#include <tuple>

#include "anigen/anymate/denoisers.h"
#include "anigen/anymate/volumes.h"
#include "anigen/geometry/nearest_point.h"

namespace anigen::anymate {

namespace {

constexpr std::int64_t kNoise = -1;
constexpr double kLeastReach = 1e-9, kMostReach = 1e9, kFarthestPoint = 1e15;
// Cells compare in single precision; what they find is compared again in double.
constexpr double kReachMargin = 1.0 + 1e-5;

class Reach {
 public:
  Reach(const std::vector<Eigen::Vector3f>& rough, std::vector<Eigen::Vector3d> points, double eps)
      : cells_(rough, static_cast<float>(eps * kReachMargin)), points_(std::move(points)), squared_(eps * eps) {}

  /// Indices within reach of a point, itself included.
  std::vector<int> of(std::size_t point) const {
    std::vector<int> found = cells_.within(point);
    const auto beyond = [&](int other) {
      return (points_[static_cast<std::size_t>(other)] - points_[point]).squaredNorm() > squared_;
    };
    found.erase(std::remove_if(found.begin(), found.end(), beyond), found.end());
    return found;
  }

 private:
  geometry::PointCells cells_;
  std::vector<Eigen::Vector3d> points_;
  double squared_;
};

constexpr double kJointQueryDeviation = 0.02;

constexpr double kRegressedEps = 0.03, kDenoisedEps = 0.05;

DbscanOptions merging(double wanted, double released) { return {wanted > 0.0 ? wanted : released, 1}; }

}  // namespace

std::vector<std::int64_t> dbscan_labels(const Tensor& points, const DbscanOptions& options) {
  require(options.eps >= kLeastReach && options.eps <= kMostReach, "eps", "must be from 1e-9 to 1e9");
  require(options.min_samples >= 1, "min_samples", "must be at least 1");
  const std::vector<Eigen::Vector3d> positions = nn::points_of<double>(points, "points");
  std::vector<Eigen::Vector3f> rough;
  rough.reserve(positions.size());
  for (const Eigen::Vector3d& point : positions) {
    const bool usable = (point.array().abs() <= kFarthestPoint).all();  // false for NaN
    require(usable, "points[" + std::to_string(rough.size()) + "]", "is not finite, or beyond 1e15");
    rough.emplace_back(point.cast<float>());
  }
  std::vector<std::int64_t> labels(positions.size(), kNoise);
  if (positions.empty()) return labels;
  const Reach reach(rough, positions, options.eps);
  std::vector<std::uint8_t> is_core(positions.size());
  for (std::size_t i = 0; i < positions.size(); ++i)
    is_core[i] = static_cast<std::int64_t>(reach.of(i).size()) >= options.min_samples ? 1 : 0;
  std::int64_t next = 0;
  std::vector<std::size_t> open;
  for (std::size_t seed = 0; seed < positions.size(); ++seed) {
    if (labels[seed] != kNoise || is_core[seed] == 0) continue;
    labels[seed] = next;
    open.assign(1, seed);
    while (!open.empty()) {
      const std::size_t point = open.back();
      open.pop_back();
      if (is_core[point] == 0) continue;  // a border point reaches no further
      for (const int other : reach.of(point)) {
        const auto neighbour = static_cast<std::size_t>(other);
        if (labels[neighbour] != kNoise) continue;
        labels[neighbour] = next;
        open.push_back(neighbour);
      }
    }
    ++next;
  }
  return labels;
}

Tensor cluster_means(const Tensor& points, const std::vector<std::int64_t>& labels) {
  require_shape(points, {static_cast<std::int64_t>(labels.size()), 3}, "points");
  std::int64_t count = 0;
  for (const std::int64_t label : labels) count = std::max(count, label + 1);
  const Tensor values = points.detach().to(torch::kCPU, torch::kFloat64);
  const Tensor of = torch::tensor(labels, torch::kInt64) + 1;  // row 0 takes the noise
  const Tensor sums = torch::zeros({count + 1, 3}, torch::kFloat64).index_add_(0, of, values);
  const Tensor sizes =
      torch::zeros({count + 1}, torch::kFloat64).index_add_(0, of, torch::ones_like(of, torch::kFloat64));
  return (sums / sizes.unsqueeze(1)).slice(0, 1).to(nn::dtype_of(points));
}

Tensor merged_joints(const Tensor& joints, const DbscanOptions& options) {
  return cluster_means(joints, dbscan_labels(joints, options));
}

JointRegressionImpl::JointRegressionImpl(const HeadOptions& options, std::int64_t num_joints, std::int64_t out_channels,
                                         nn::Init init)
    : width_(options.width) {
  require(num_joints > 0, "num_joints", "must be positive");
  query_ = register_parameter("query", torch::empty({num_joints, options.width}));
  cross_attn_decoder_ =
      register_module("cross_attn_decoder", ResidualCrossAttention(options.width, options.heads, options.qkv_bias));
  ln_post_ = register_module("ln_post", nn::AffineLayerNorm(options.width, kNormEps));
  output_proj_ = register_module("output_proj", nn::Linear(options.width, out_channels));
  if (init == nn::Init::kNone) return;
  default_layers(*this);
  normal_blocks(*this, options.init_scale);
  torch::nn::init::normal_(query_, 0.0, kJointQueryDeviation);
}

Tensor JointRegressionImpl::forward(const Tensor& latents) {
  require_shape(latents, {-1, -1, width_}, "latents");
  const Tensor queries = query_.unsqueeze(0).expand({latents.size(0), -1, -1});
  return output_proj_(ln_post_(cross_attn_decoder_(queries, latents)));
}

Tensor joint_chamfer_loss(const Tensor& predicted, const Tensor& joints, const std::vector<std::int64_t>& counts) {
  require_shape(predicted, {-1, -1, 3}, "predicted");
  require_shape(joints, {predicted.size(0), -1, 3}, "joints");
  require(static_cast<std::int64_t>(counts.size()) == predicted.size(0), "joints_num", "must be one for each item");
  std::vector<Tensor> items;
  for (std::size_t b = 0; b < counts.size(); ++b) {
    require(counts[b] >= 1 && counts[b] <= joints.size(1), "joints_num", "is not between 1 and the padded number");
    const auto item = static_cast<std::int64_t>(b);
    const Tensor truth = joints[item].narrow(0, 0, counts[b]);
    const Tensor distance = (predicted[item].unsqueeze(1) - truth.unsqueeze(0)).norm(2, -1);
    items.push_back(0.5 * (std::get<0>(distance.min(1)).mean() + std::get<0>(distance.min(0)).mean()));
  }
  return torch::stack(items).mean();
}

Tensor predicted_joints(AnymateModelImpl& model, const Tensor& latents, const JointPrediction& options) {
  require(latents.defined() && latents.dim() >= 2 && latents.size(0) == 1, "latents", "must be of one shape");
  const torch::NoGradGuard no_grad;
  switch (task_of(model.options().decoder)) {
    case Task::kJointRegression: {
      const Tensor joints = model.decoder<JointRegressionImpl>().forward(latents)[0];
      return merged_joints(joints, merging(options.eps, kRegressedEps)).to(torch::kFloat32);
    }
    case Task::kDenoisedJoints: {
      require_shape(options.noise, {1, -1, 3}, "noise");
      const DdimSchedule schedule(options.train_steps);
      const Tensor joints = sample_joints(model.decoder<JointDenoiserImpl>(), schedule, latents, options.noise)[0];
      return merged_joints(joints, merging(options.eps, kDenoisedEps)).to(torch::kFloat32);
    }
    case Task::kJointVolume: {
      require_shape(options.cells, {-1, 3}, "cells");
      const Tensor field = joint_volume(model.decoder<JointVolumeImpl>(), latents, options.cells);
      return joint_key_points(field, options.cells).to(torch::kFloat32);
    }
    default:
      throw InputError("", "decoder", "'" + name_of(model.options().decoder) + "' does not predict joints");
  }
}

}  // namespace anigen::anymate
