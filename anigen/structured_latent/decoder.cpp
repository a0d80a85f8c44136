#include "anigen/structured_latent/decoder.h"

#include <algorithm>
#include <numeric>
#include <system_error>
#include <utility>

#include "anigen/core/config.h"
#include "anigen/core/error.h"
#include "anigen/nn/norms.h"
#include "anigen/shape_field/cube_field.h"

namespace anigen::structured_latent {

namespace {

sparse::SubdivideBlock subdivide_block(std::int64_t channels, std::int64_t out_channels) {
  sparse::SubdivideBlockOptions options;
  options.channels = channels;
  options.out_channels = out_channels;
  return sparse::SubdivideBlock(options);
}

using torch::Tensor;

constexpr std::int64_t kCubeCorners = 8, kCubeWeights = 21;

// Widths of the fields at one place.
std::vector<std::int64_t> field_widths(const SkeletonHeadLayout& layout) {
  std::vector<std::int64_t> widths{3, 3};
  if (layout.joint_confidence) widths.insert(widths.end(), {1, 1});
  if (layout.skin_confidence) widths.push_back(1);
  widths.push_back(layout.skin_channels);
  return widths;
}

struct FieldRows {
  Tensor places;  // [M, 3] indices
  Tensor values;  // [M, sum of the widths]
};

// Means at grid vertices of what the voxels around them say of their corners.
FieldRows averaged_corners(const Tensor& coords, const Tensor& raw, const SkeletonHeadLayout& layout) {
  std::vector<std::int64_t> widths = field_widths(layout);
  for (std::int64_t& width : widths) width *= kCubeCorners;
  std::vector<Tensor> per_corner;
  for (const Tensor& part : raw.split_with_sizes(widths, 1)) {
    per_corner.push_back(part.reshape({raw.size(0), kCubeCorners, part.size(1) / kCubeCorners}));
  }
  shape_field::CubeCorners corners;
  corners.coords = nn::to_device(coords.contiguous(), raw.device());
  corners.attributes = torch::cat(per_corner, 2);
  // There is no surface here: the parts of the field that make one stay empty.
  corners.sdf = raw.new_zeros({raw.size(0), kCubeCorners});
  corners.deform = raw.new_zeros({raw.size(0), kCubeCorners, 3});
  corners.weights = raw.new_zeros({raw.size(0), kCubeWeights});
  const shape_field::CubeField field = shape_field::average_corners(corners, layout.resolution);
  return {field.vertices, field.attributes};
}

skeleton_field::SkeletonField activated(const FieldRows& rows, const SkeletonHeadLayout& layout) {
  const std::vector<Tensor> parts = rows.values.split_with_sizes(field_widths(layout), 1);
  skeleton_field::SkeletonField field;
  const Tensor places = nn::to_device(rows.places.contiguous(), rows.values.device()).to(torch::kFloat32);
  field.positions = (places + 0.5) / static_cast<double>(layout.resolution) - 0.5;
  const Tensor origin = field.positions.to(rows.values.scalar_type());
  field.joints = layout.residual ? parts[0] + origin : parts[0];
  field.parents = layout.residual ? parts[1] + origin : parts[1];
  std::size_t next = 2;
  if (layout.joint_confidence) {
    field.conf_j = layout.continuous ? torch::sigmoid(parts[next]) : parts[next];
    field.conf_p = layout.continuous ? torch::sigmoid(parts[next + 1]) : parts[next + 1];
    next += 2;
  }
  if (layout.continuous) field.conf_skin = field.conf_j;
  if (layout.skin_confidence) field.conf_skin = torch::sigmoid(parts[next++]);
  field.skin_features = parts[next];
  return field;
}

using sparse::SparseTensor;

nn::FreezableModel::Parts decoder_parts(const StructuredLatentDecoderOptions& options) {
  nn::FreezableModel::Parts parts;
  parts.torso = StructuredLatentTorso::names();
  parts.torso.insert(parts.torso.end(), {"upsample", "upsample_skin_net"});
  if (options.upsample_skl) parts.torso.push_back("upsample_skl_net");
  if (options.skin_cross_from_groupped) {
    for (const std::string& name : GroupedCross::names()) parts.torso.push_back(name);
  }
  parts.other_fp16 = {"skin_decoder.blocks_vertex", "skin_decoder.blocks_skin"};
  parts.use_fp16 = options.use_fp16;
  parts.to_freeze = options.modules_to_freeze;
  return parts;
}

void check_skeleton(const skeleton_field::SkeletonTensors& skeleton, const std::string& place) {
  const Tensor &joints = skeleton.joints, &parents = skeleton.parents;
  if (!joints.defined() || joints.dim() != 2 || joints.size(1) != 3 || !torch::isfinite(joints).all().item<bool>())
    throw InputError("", place, "joints must be finite positions [J, 3], found " + nn::shape_text(joints));
  if (!parents.defined() || parents.dim() != 1 || parents.size(0) != joints.size(0) || parents.is_floating_point())
    throw InputError("", place, "parents must be one integer per joint, found " + nn::shape_text(parents));
  if (parents.numel() == 0) return;
  if (parents.min().item<std::int64_t>() < -1 || parents.max().item<std::int64_t>() >= joints.size(0))
    throw InputError("", place, "a parent is none of the " + std::to_string(joints.size(0)) + " joints");
}

void check_given(const std::vector<skeleton_field::SkeletonTensors>& given, std::int64_t assets) {
  if (given.empty()) return;
  if (static_cast<std::int64_t>(given.size()) != assets) {
    throw InputError("", "skeletons",
                     std::to_string(given.size()) + " are given for " + std::to_string(assets) + " assets");
  }
  for (std::size_t i = 0; i < given.size(); ++i) check_skeleton(given[i], "skeleton " + std::to_string(i));
}

// The mesh of each asset. @param fine channels of the mesh field on fine voxels
std::vector<shape_field::ExtractedMesh> meshes_of(const SparseTensor& fine, const shape_field::MeshFieldOptions& layout,
                                                  bool training, shape_field::SkinFeatures skin_features) {
  const nn::Ragged& items = fine.support->items();
  const std::vector<Tensor> coords = items.split(fine.support->coords().slice(1, 1));
  // The backward pass of a split is a copy.
  const std::vector<Tensor> feats = items.items() == 1 ? std::vector<Tensor>{fine.feats} : items.split(fine.feats);
  std::vector<shape_field::ExtractedMesh> meshes;
  for (std::size_t i = 0; i < feats.size(); ++i)
    meshes.push_back(shape_field::extract_mesh(coords[i], feats[i], layout, training, skin_features));
  return meshes;
}

}  // namespace

StructuredLatentUpsampler::StructuredLatentUpsampler(torch::nn::Module& model, const char* name, std::int64_t channels,
                                                     std::int64_t between, std::int64_t behind) {
  blocks_ = {subdivide_block(channels, between), subdivide_block(between, behind)};
  model.register_module(name, nn::module_list(blocks_));
}

sparse::SparseTensor StructuredLatentUpsampler::forward(const sparse::SparseTensor& x, bool recompute) {
  sparse::SparseTensor h = x;
  for (sparse::SubdivideBlock& block : blocks_) {
    h = run_part(recompute, h.with(h.feats.to(block->dtype())),
                 [block](const sparse::SparseTensor& rows) mutable { return block->forward(rows); });
  }
  return h;
}

SkeletonHeadLayout::SkeletonHeadLayout(const StructuredLatentDecoderOptions& options)
    : resolution(options.skeleton_resolution()),
      skin_channels(options.skin_feat_channels()),
      joint_confidence(options.has_joint_confidence()),
      skin_confidence(options.has_skin_confidence()),
      on_center(options.skl_defined_on_center),
      residual(options.jp_residual_fields),
      continuous(options.jp_hyper_continuous) {}

std::int64_t SkeletonHeadLayout::joint_channels() const {
  const std::vector<std::int64_t> widths = field_widths(*this);
  const std::int64_t all = std::accumulate(widths.begin(), widths.end(), std::int64_t{0});
  return (all - skin_channels) * (on_center ? 1 : kCubeCorners);
}

std::vector<skeleton_field::SkeletonField> skeleton_fields(const sparse::SparseTensor& raw,
                                                           const SkeletonHeadLayout& layout) {
  const std::int64_t channels = layout.joint_channels() + layout.skin_feature_channels();
  if (raw.feats.dim() != 2 || raw.feats.size(1) != channels) {
    throw InputError("", "skeleton field",
                     "must have " + std::to_string(channels) + " channels, found " + nn::shape_text(raw.feats));
  }
  const std::vector<Tensor> coords = raw.support->items().split(raw.support->coords().slice(1, 1));
  const std::vector<Tensor> rows = raw.support->items().split(raw.feats);
  std::vector<skeleton_field::SkeletonField> result;
  for (std::size_t i = 0; i < rows.size(); ++i) {
    result.push_back(activated(
        layout.on_center ? FieldRows{coords[i], rows[i]} : averaged_corners(coords[i], rows[i], layout), layout));
  }
  return result;
}

StructuredLatentDecoderImpl::StructuredLatentDecoderImpl(const StructuredLatentDecoderOptions& options, nn::Init init)
    : nn::FreezableModel(decoder_parts(options)),
      options_(options),
      mesh_options_(options.mesh_options()),
      layout_(options),
      recompute_(options.use_checkpoint) {
  options.validate();
  const std::int64_t width = options.model_channels, skin = options.model_channels_skin,
                     skeleton = options.model_channels_skl, skin_features = options.skin_feat_channels();
  const std::int64_t between = width / 4, behind = width / 8;  // also of the other streams' up-sampling
  // In the order of published state dicts.
  torso_ = StructuredLatentTorso(
      *this, options, {options.latent_channels, options.latent_channels_vertskin, options.latent_channels_skl});
  skin_decoder_ = register_module("skin_decoder", skin_field::SkinDecoder(options.skin_decoder_config));
  if (options.h_skin_unet_num_levels >= 1)
    skin_unet_ = register_module("h_skin_unet", SkinUnet(skin, options.h_skin_unet_num_levels));
  if (options.skin_cross_from_groupped) grouped_cross_ = GroupedCross(*this, options);
  upsample_ = StructuredLatentUpsampler(*this, "upsample", width, between, behind);
  upsample_skin_ = StructuredLatentUpsampler(*this, "upsample_skin_net", skin, between, behind);
  const std::int64_t skin_head = 8 * skin_features, surface_head = mesh_options_.channels() - skin_head;
  out_layer_ = register_module("out_layer", nn::Linear(behind, surface_head));
  out_layer_skin_ = register_module("out_layer_skin", nn::Linear(behind, skin_head));
  const std::int64_t skeleton_width = options.upsample_skl ? behind : skeleton;
  out_layer_skl_skin_ =
      register_module("out_layer_skl_skin", nn::Linear(skeleton_width, layout_.skin_feature_channels()));
  if (options.upsample_skl)
    upsample_skeleton_ = StructuredLatentUpsampler(*this, "upsample_skl_net", skeleton, between, behind);
  out_layer_skl_ = register_module("out_layer_skl", nn::Linear(skeleton_width, layout_.joint_channels()));
  if (init == nn::Init::kPublished) {
    initialize_sparse_layers(*this);
    skin_decoder_->initialize();
    grouped_cross_.initialize();
    for (nn::Linear* head : {&out_layer_, &out_layer_skin_, &out_layer_skl_skin_, &out_layer_skl_})
      initialize_field_head(**head);
  }
  if (options.freezes()) apply_freezing();
}

void StructuredLatentDecoderImpl::recompute_blocks(bool on) {
  recompute_ = on;
  torso_.recompute_blocks(on);
}

void StructuredLatentDecoderImpl::group_with(
    std::function<skeleton_field::SkeletonTensors(const skeleton_field::SkeletonField&)> grouping) {
  grouping_ = std::move(grouping);
}

StructuredLatentDecoderImpl::Fields StructuredLatentDecoderImpl::forward(
    const SparseTensor& z, const SparseTensor& z_skl, const std::vector<skeleton_field::SkeletonTensors>& given) {
  const std::int64_t channels = options_.latent_channels;
  check_voxel_features(z, channels + options_.latent_channels_vertskin, options_.resolution, "z");
  return forward({z.with(z.feats.slice(1, 0, channels)), z.with(z.feats.slice(1, channels)), z_skl}, given);
}

PerStream<SparseTensor> StructuredLatentDecoderImpl::streams_of(const PerStream<SparseTensor>& z) {
  check_voxel_features(z.geometry, options_.latent_channels, options_.resolution, "z");
  check_voxel_features(z.skin, options_.latent_channels_vertskin, options_.resolution, "z of the skin");
  check_voxel_features(z.skeleton, options_.latent_channels_skl, options_.resolution, "z_skl");
  const std::int64_t assets = z.geometry.support->items().items();
  if (z.skin.support != z.geometry.support || z.skeleton.support->items().items() != assets) {
    throw InputError("", "z_skl",
                     std::to_string(z.skeleton.support->items().items()) + " assets, but z has " +
                         std::to_string(assets) + "; geometry and skin share their voxels");
  }
  const auto entering = [&](const SparseTensor& x) {
    return options_.normalize_z ? x.with(nn::unit_length(x.feats)) : x;
  };
  PerStream<SparseTensor> h = torso_.forward({z.geometry, entering(z.skin), entering(z.skeleton)});
  if (!skin_unet_.is_empty()) h.skin = skin_unet_->forward(h.skin);
  return h;
}

StructuredLatentDecoderImpl::RigFields StructuredLatentDecoderImpl::rig_fields(const PerStream<SparseTensor>& z) {
  const PerStream<SparseTensor> h = streams_of(z);
  return {skeleton_fields(skeleton_channels(h.skeleton), layout_), h.skin};
}

StructuredLatentDecoderImpl::Fields StructuredLatentDecoderImpl::forward(
    const PerStream<SparseTensor>& z, const std::vector<skeleton_field::SkeletonTensors>& given) {
  PerStream<SparseTensor> h = streams_of(z);
  check_given(given, z.geometry.support->items().items());
  Fields decoded;
  decode_joints(h.skeleton, given, decoded);
  if (grouped_cross_.present()) h.skin = grouped_cross_.forward(h.skin, decoded.joints, decoded.joint_features);
  decoded.skin_coarse = h.skin.feats.to(nn::dtype_of(out_layer_->weight));
  decoded.mesh = decode_surface(h.geometry, h.skin);
  return decoded;
}

SparseTensor StructuredLatentDecoderImpl::skeleton_channels(const SparseTensor& h) {
  SparseTensor fine = upsample_skeleton_.present() ? upsample_skeleton_.forward(h, recompute_) : h;
  fine.feats = fine.feats.to(nn::dtype_of(out_layer_skl_->weight));
  return fine.with(torch::cat({out_layer_skl_->forward(fine.feats), out_layer_skl_skin_->forward(fine.feats)}, 1));
}

void StructuredLatentDecoderImpl::decode_joints(const SparseTensor& h,
                                                const std::vector<skeleton_field::SkeletonTensors>& given,
                                                Fields& decoded) {
  decoded.skeleton = skeleton_channels(h);
  decoded.skeletons = skeleton_fields(decoded.skeleton, layout_);
  for (std::size_t i = 0; i < decoded.skeletons.size(); ++i) {
    const skeleton_field::SkeletonField& field = decoded.skeletons[i];
    decoded.joints.push_back(!given.empty() ? given[i]
                             : grouping_    ? grouping_(field)
                                            : skeleton_field::group_votes(field, options_.grouping_strategy));
    decoded.joint_features.push_back(skeleton_field::joint_skin_features(field, decoded.joints.back().joints));
  }
}

SparseTensor StructuredLatentDecoderImpl::shape_channels(const SparseTensor& geometry) {
  SparseTensor fine = upsample_.forward(geometry, recompute_);
  fine.feats = out_layer_->forward(fine.feats.to(nn::dtype_of(out_layer_->weight)));
  return fine;
}

SparseTensor StructuredLatentDecoderImpl::decode_surface(const SparseTensor& geometry, const SparseTensor& skin) {
  // One stream after the other: the voxels of the fine grid are the largest tensors there are.
  const Tensor skin_channels = [&] {
    const Tensor fine_skin = upsample_skin_.forward(skin, recompute_).feats;
    return out_layer_skin_->forward(fine_skin.to(nn::dtype_of(out_layer_skin_->weight)));
  }();
  SparseTensor fine = shape_channels(geometry);
  fine.feats = torch::cat({fine.feats, skin_channels}, 1);
  return fine;
}

std::vector<shape_field::ExtractedMesh> StructuredLatentDecoderImpl::extract_meshes(
    const Fields& decoded, bool training, shape_field::SkinFeatures skin_features) {
  return meshes_of(decoded.mesh, mesh_options_, training, skin_features);
}

std::vector<shape_field::ExtractedMesh> StructuredLatentDecoderImpl::decode_shapes(const SparseTensor& z) {
  check_voxel_features(z, options_.latent_channels, options_.resolution, "z");
  shape_field::MeshFieldOptions bare = mesh_options_;
  bare.skin_channels = 0;
  return meshes_of(shape_channels(torso_.forward_geometry(z)), bare, /*training=*/false,
                   shape_field::SkinFeatures::kWhenAskedFor);
}

Tensor StructuredLatentDecoderImpl::skin_weights(const Tensor& vertex_features,
                                                 const skeleton_field::SkeletonTensors& skeleton,
                                                 const Tensor& joint_features, std::int64_t max_bytes) {
  check_skeleton(skeleton, "skeleton");
  const std::int64_t joints = skeleton.joints.size(0), channels = options_.skin_feat_channels();
  const auto check_features = [&](const Tensor& features, std::int64_t rows, const char* name) {
    const bool fits = features.defined() && features.dim() == 2 && features.size(1) == channels;
    if (fits && (rows < 0 || features.size(0) == rows)) return;
    throw InputError("", name,
                     "must be [" + (rows < 0 ? std::string("V") : std::to_string(rows)) + ", " +
                         std::to_string(channels) + "], found " + nn::shape_text(features));
  };
  check_features(vertex_features, -1, "vertex features");
  check_features(joint_features, joints, "joint features");
  if (joints == 0) throw InputError("", "skeleton", "there are no joints to give weight to");

  const auto type = out_layer_skin_->weight.options();
  const skin_field::SkeletonBatch batch =
      skin_field::SkeletonBatch::from_lists({skeleton.joints}, {skeleton.parents}).to(type.device());
  const skin_field::SkinDecoderImpl::JointKeys keys = skin_decoder_->joint_keys(joint_features.to(type), batch);
  const Tensor points = vertex_features.to(type);
  // Upper bound of the memory of a point: two hidden layers four times as wide, and logits, scaled and through the
  // softmax; with cross blocks scores of every head.
  const skin_field::SkinDecoderOptions& decoder = options_.skin_decoder_config;
  const std::int64_t heads = decoder.vert_cross_blocks_num > 0 ? decoder.num_heads : 0;
  const std::int64_t per_point = 4 * (16 * decoder.model_channels + (3 + 3 * heads) * joints);
  const std::int64_t chunk = std::max<std::int64_t>(1, max_bytes / per_point), total = points.size(0);
  const auto weights_of = [&](std::int64_t begin) {
    const Tensor rows = points.slice(0, begin, std::min(begin + chunk, total));
    return torch::softmax(skin_decoder_->logits(rows, nn::Ragged(std::vector<std::int64_t>{rows.size(0)}), keys)[0],
                          -1);
  };
  if (total <= chunk) return weights_of(0);
  const Tensor first = weights_of(0);
  if (first.requires_grad()) {
    std::vector<Tensor> parts{first};
    for (std::int64_t begin = chunk; begin < total; begin += chunk) parts.push_back(weights_of(begin));
    return torch::cat(parts, 0);
  }
  const Tensor weights = torch::empty({total, joints}, first.options());
  weights.slice(0, 0, chunk).copy_(first);
  for (std::int64_t begin = chunk; begin < total; begin += chunk)
    weights.slice(0, begin, std::min(begin + chunk, total)).copy_(weights_of(begin));
  return weights;
}

StructuredLatentVariant variant_of_run(const nn::RunModel& decoder) {
  const auto options =
      StructuredLatentDecoderOptions::from_json(decoder.args, decoder.config.string(), decoder.pointer);
  return StructuredLatentVariant::of_run(decoder.run, options, decoder.config.string());
}

skeleton_field::MeanShiftOptions grouping_of_run(skeleton_field::MeanShiftOptions asked,
                                                 const std::filesystem::path& run) {
  skeleton_field::MeanShiftOptions fitted;
  const std::filesystem::path file = grouping_file(run);
  std::error_code error;
  if (std::filesystem::is_regular_file(file, error)) {
    const Json json = read_json(file);
    ConfigReader reader(json, file.string());
    fitted.bandwidth = static_cast<float>(reader.number("bandwidth", 0.01, 1e-6, 1.0));
    fitted.min_cluster_size = static_cast<int>(reader.integer("least_votes", 5, 1, 1'000'000));
  }
  if (asked.bandwidth <= 0.0F) asked.bandwidth = fitted.bandwidth;
  if (asked.min_cluster_size <= 0) asked.min_cluster_size = fitted.min_cluster_size;
  return asked;
}

skeleton_field::MeanShiftOptions in_form_of(skeleton_field::MeanShiftOptions asked,
                                            const StructuredLatentVariant& variant) {
  if (asked.form == skeleton_field::MeanShiftForm::kOfRun) asked.form = variant.grouping;
  return asked;
}

StructuredLatentDecoder load_rig_decoder(const nn::RunModel& found, torch::Device device,
                                         const skeleton_field::MeanShiftOptions& grouping) {
  const StructuredLatentVariant variant = variant_of_run(found);
  if (variant.geometry_only) {
    throw InputError(found.config.string(), "/trainer/args/geometry_only",
                     "this run trained the shape alone: its skeletons and weights mean nothing");
  }
  StructuredLatentDecoder decoder = nn::load_trained<StructuredLatentDecoder>(found, device);
  const std::string strategy = decoder->options().grouping_strategy;
  decoder->group_with([confidence = variant.confidence, strategy,
                       grouping = in_form_of(grouping_of_run(grouping, found.config.parent_path()), variant)](
                          const skeleton_field::SkeletonField& field) {
    return skeleton_field::group_votes(for_grouping(field, confidence), strategy, grouping);
  });
  return decoder;
}

}  // namespace anigen::structured_latent
