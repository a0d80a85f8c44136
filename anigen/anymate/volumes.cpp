#include "anigen/anymate/volumes.h"

#include <algorithm>
#include <memory>
#include <string>
#include <tuple>

#include "anigen/anymate/denoisers.h"
#include "anigen/anymate/joints.h"
#include "anigen/nn/condition_cache.h"

namespace anigen::anymate {

namespace {

constexpr double kHeatSigma = 2.0 / kVolumeSide;
constexpr double kLevelShare = 0.85, kClusterLevelShare = 0.1;  // of the maximum; the rest is of the minimum
constexpr std::int64_t kLargeCluster = 10;                      // cells; such clusters are cut again
constexpr double kCellReach = 1.8;                              // between √3 and 2: all 26 neighbours

void require_voxels(const Tensor& voxels) {
  require_shape(voxels, {-1, 3}, "vox");
  require(!voxels.is_floating_point(), "vox", "holds indices of cells, which are integers");
  require(voxels.numel() == 0 ||
              (voxels.min().item<std::int64_t>() >= 0 && voxels.max().item<std::int64_t>() < kVolumeSide),
          "vox", "holds an index outside [0, " + std::to_string(kVolumeSide) + ")");
}

struct CellValues {
  Tensor cells;   // [N, 3] int64
  Tensor values;  // [N] fp64

  CellValues rows(const Tensor& which) const { return {cells.index_select(0, which), values.index_select(0, which)}; }
  CellValues above(double level) const { return rows((values >= level).nonzero().flatten()); }
};

// Every cell once, in x, y, z order.
CellValues distinct_cells(const Tensor& logits, const Tensor& voxels) {
  const Tensor cells = voxels.to(torch::kCPU, torch::kInt64);
  const Tensor number = (cells.select(1, 0) * kVolumeSide + cells.select(1, 1)) * kVolumeSide + cells.select(1, 2);
  Tensor grid = torch::full({kVolumeSide * kVolumeSide * kVolumeSide}, -1, torch::kInt64);
  const std::int64_t* at = number.data_ptr<std::int64_t>();
  auto* last = grid.data_ptr<std::int64_t>();
  for (std::int64_t i = 0; i < number.size(0); ++i) last[at[i]] = i;
  const CellValues all = {cells, logits.detach().to(torch::kCPU, torch::kFloat64).flatten()};
  return all.rows(grid.index_select(0, (grid >= 0).nonzero().flatten()));
}

std::vector<CellValues> clusters_of(const CellValues& found) {
  const DbscanOptions options = {kCellReach, 1};
  const std::vector<std::int64_t> labels = dbscan_labels(found.cells.to(torch::kFloat64), options);
  std::vector<std::vector<std::int64_t>> members;
  for (std::size_t i = 0; i < labels.size(); ++i) {
    const auto label = static_cast<std::size_t>(labels[i]);
    if (label >= members.size()) members.resize(label + 1);
    members[label].push_back(static_cast<std::int64_t>(i));
  }
  std::vector<CellValues> clusters;
  for (const std::vector<std::int64_t>& rows : members) clusters.push_back(found.rows(torch::tensor(rows)));
  return clusters;
}

double mixed(const Tensor& values, double share) {
  return share * values.max().item<double>() + (1.0 - share) * values.min().item<double>();
}

// Cuts a cluster until its parts are small, and appends the centre of each.
void add_key_points(const CellValues& cluster, std::vector<Tensor>& points) {
  if (cluster.values.size(0) >= kLargeCluster) {
    const CellValues kept = cluster.above(mixed(cluster.values, kClusterLevelShare));
    if (kept.values.size(0) < cluster.values.size(0)) {
      for (const CellValues& part : clusters_of(kept)) add_key_points(part, points);
      return;
    }
  }
  points.push_back(cluster.cells.to(torch::kFloat64).mean(0) * (2.0 / kVolumeSide) - 1.0);
}

constexpr std::int64_t kPlanes = 3, kHeadHidden = 64;

StyleGeneratorOptions with_planes(StyleGeneratorOptions options) {
  options.img_channels = kPlanes * kPlaneChannels;
  return options;
}

}  // namespace

Tensor voxel_corners(const Tensor& voxels) {
  require_voxels(voxels);
  return voxels.to(torch::kFloat32) / static_cast<double>(kVolumeSide) * 2.0 - 1.0;
}

Tensor training_voxels(const Tensor& voxels, std::int64_t most) {
  require_shape(voxels, {-1, 3}, "vox");
  require(most > 0, "most", "must be positive");
  if (voxels.size(0) <= most) return voxels;
  const Tensor rows = torch::randperm(voxels.size(0), torch::kInt64).slice(0, 0, most);
  return voxels.index_select(0, rows.to(voxels.device()));
}

Tensor joint_heat(const Tensor& queries, const Tensor& joints) {
  require_shape(queries, {-1, 3}, "queries");
  require_shape(joints, {-1, 3}, "joints");
  require(joints.size(0) > 0, "joints", "there is none");
  const Tensor squared = (queries.unsqueeze(1) - joints.unsqueeze(0)).square().sum(-1);
  return (std::get<0>(squared.min(1)) / (-2.0 * kHeatSigma * kHeatSigma)).exp();
}

Tensor joint_volume_loss(JointVolumeImpl& model, const Tensor& latents, const std::vector<Tensor>& voxels,
                         const std::vector<Tensor>& joints) {
  require(latents.defined() && latents.dim() >= 2, "latents", "must have an axis of items");
  const std::size_t count = voxels.size();
  require(count > 0 && count == joints.size() && static_cast<std::int64_t>(count) == latents.size(0), "vox",
          "latents, voxels and joints must be of the same items");
  std::vector<Tensor> items;
  for (std::size_t b = 0; b < count; ++b) {
    require(voxels[b].defined() && voxels[b].size(0) > 0, "vox[" + std::to_string(b) + "]", "has no voxel");
    const Tensor queries = voxel_corners(voxels[b]).to(latents.device());
    const Tensor logits = model.forward(latents.narrow(0, static_cast<std::int64_t>(b), 1), queries.unsqueeze(0));
    const Tensor heat = joint_heat(queries, joints[b].to(queries.options()));
    items.push_back(torch::binary_cross_entropy_with_logits(logits.flatten(), heat.to(logits.dtype())));
  }
  return torch::stack(items).mean();
}

Tensor joint_volume(JointVolumeImpl& model, const Tensor& latents, const Tensor& voxels, std::int64_t chunk) {
  require(chunk > 0, "chunk", "must be positive");
  require(latents.defined() && latents.dim() >= 2 && latents.size(0) == 1, "latents", "must be of one item");
  const torch::NoGradGuard no_grad;
  const nn::ConditionCache contexts;  // what a field makes of the latents is the same for every chunk
  std::vector<Tensor> parts;
  const Tensor queries = voxel_corners(voxels).to(latents.device());
  for (const Tensor& part : queries.split(chunk, 0)) parts.push_back(model.forward(latents, part.unsqueeze(0))[0]);
  return torch::cat(parts, 0);
}

Tensor joint_key_points(const Tensor& logits, const Tensor& voxels) {
  require_voxels(voxels);
  require(logits.defined() && logits.numel() == voxels.size(0), "logits", "must be one for each voxel");
  require(logits.isfinite().all().item<bool>(), "logits", "holds a value that is not finite");
  std::vector<Tensor> points;
  if (logits.numel() > 0) {
    const CellValues all = distinct_cells(logits, voxels);
    const double level = std::min(mixed(all.values, kLevelShare), 0.0);
    for (const CellValues& cluster : clusters_of(all.above(level))) add_key_points(cluster, points);
  }
  return points.empty() ? torch::empty({0, 3}, torch::kFloat64) : torch::stack(points);
}

ImplicitVolumeImpl::ImplicitVolumeImpl(const HeadOptions& options, nn::Init init) : options_(options) {
  const std::int64_t width = options.width;
  query_proj_ = register_module("query_proj", nn::Linear(fourier_width(options.num_freqs), width));
  cross_attn_decoder_ =
      register_module("cross_attn_decoder", ResidualCrossAttention(width, options.heads, options.qkv_bias));
  ln_post_ = register_module("ln_post", nn::AffineLayerNorm(width, kNormEps));
  output_proj_ = register_module("output_proj", nn::Linear(width, 1));
  start_blocks(*this, options.init_scale, init);
}

Tensor ImplicitVolumeImpl::forward(const Tensor& latents, const Tensor& queries) {
  require_shape(latents, {-1, -1, options_.width}, "latents");
  require_shape(queries, {latents.size(0), -1, 3}, "queries");
  const Tensor x = query_proj_(fourier_features(queries, options_.num_freqs, /*include_pi=*/true));
  return output_proj_(ln_post_(cross_attn_decoder_(x, latents)));
}

Tensor triplane_axes() {
  return torch::tensor({1.0F, 0.0F, 0.0F, 0.0F, 1.0F, 0.0F, 0.0F, 0.0F, 1.0F,   // x, y
                        1.0F, 0.0F, 0.0F, 0.0F, 0.0F, 1.0F, 0.0F, 1.0F, 0.0F,   // x, z
                        0.0F, 0.0F, 1.0F, 1.0F, 0.0F, 0.0F, 0.0F, 1.0F, 0.0F})  // z, x
      .view({kPlanes, 3, 3});
}

Tensor sample_planes(const Tensor& planes, const Tensor& queries) {
  require_shape(planes, {-1, kPlanes, -1, -1, -1}, "planes");
  require_shape(queries, {planes.size(0), -1, 3}, "queries");
  const std::int64_t items = planes.size(0), count = queries.size(1);
  const Tensor axes = triplane_axes().to(queries.options()).slice(1, 0, 2);       // [3, 2, 3]
  const Tensor grid = torch::matmul(queries.unsqueeze(1), axes.transpose(1, 2));  // [B, 3, V, 2]
  namespace F = torch::nn::functional;
  const auto options =
      F::GridSampleFuncOptions().mode(torch::kBilinear).padding_mode(torch::kZeros).align_corners(false);
  const Tensor found = F::grid_sample(planes.flatten(0, 1), grid.view({items * kPlanes, 1, count, 2}), options);
  return found.view({items, kPlanes, planes.size(2), count}).transpose(2, 3);
}

PlaneHeadImpl::PlaneHeadImpl() {
  const auto net = register_module("net", std::make_shared<torch::nn::Module>());
  first_ = net->register_module("0", EqualizedLinear(kPlaneChannels, kHeadHidden));
  second_ = net->register_module("2", EqualizedLinear(kHeadHidden, 1));
}

void PlaneHeadImpl::initialize() {
  first_->initialize();
  second_->initialize();
}

Tensor PlaneHeadImpl::forward(const Tensor& sampled) {
  require_shape(sampled, {-1, kPlanes, -1, kPlaneChannels}, "sampled");
  return second_(torch::softplus(first_(sampled.mean(1))));
}

TriplaneVolumeImpl::TriplaneVolumeImpl(const StyleGeneratorOptions& options, nn::Init init) {
  backbone_ = register_module("backbone", StyleGenerator(with_planes(options)));
  decoder_ = register_module("decoder", PlaneHead());
  if (init == nn::Init::kNone) return;
  backbone_->initialize();
  decoder_->initialize();
}

Tensor TriplaneVolumeImpl::styles(const Tensor& z) {
  return backbone_->style(z).unsqueeze(1).expand({-1, backbone_->num_ws(), -1});
}

Tensor TriplaneVolumeImpl::planes(const Tensor& z, std::optional<StyleNoise> noise) {
  const StyleNoise kind = noise.value_or(is_training() ? StyleNoise::kRandom : StyleNoise::kConst);
  const Tensor image = backbone_->image(backbone_->style(z), kind);
  return image.view({z.size(0), kPlanes, kPlaneChannels, image.size(2), image.size(3)});
}

Tensor TriplaneVolumeImpl::forward(const Tensor& latents, const Tensor& queries) {
  return logits(nn::context_of(this, latents, [&] { return planes(latents); }), queries);
}

}  // namespace anigen::anymate
