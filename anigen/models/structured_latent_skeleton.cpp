#include "anigen/models/structured_latent_skeleton.h"

#include <numeric>

#include "anigen/core/error.h"
#include "anigen/fields/cube_field.h"
#include "anigen/nn/shape_text.h"

namespace anigen::models {
namespace {

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
  fields::CubeCorners corners;
  corners.coords = coords.to(raw.device());
  corners.attributes = torch::cat(per_corner, 2);
  // There is no surface here: the parts of the field that make one stay empty.
  corners.sdf = raw.new_zeros({raw.size(0), kCubeCorners});
  corners.deform = raw.new_zeros({raw.size(0), kCubeCorners, 3});
  corners.weights = raw.new_zeros({raw.size(0), kCubeWeights});
  const fields::CubeField field = fields::average_corners(corners, layout.resolution);
  return {field.vertices, field.attributes};
}

fields::SkeletonField activated(const FieldRows& rows, const SkeletonHeadLayout& layout) {
  const std::vector<Tensor> parts = rows.values.split_with_sizes(field_widths(layout), 1);
  fields::SkeletonField field;
  field.positions =
      (rows.places.to(rows.values.device(), torch::kFloat32) + 0.5) / static_cast<double>(layout.resolution) - 0.5;
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

}  // namespace

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

std::vector<fields::SkeletonField> skeleton_fields(const sparse::SparseTensor& raw, const SkeletonHeadLayout& layout) {
  const std::int64_t channels = layout.joint_channels() + layout.skin_feature_channels();
  if (raw.feats.dim() != 2 || raw.feats.size(1) != channels) {
    throw InputError("", "skeleton field",
                     "must have " + std::to_string(channels) + " channels, found " + nn::shape_text(raw.feats));
  }
  const std::vector<Tensor> coords = raw.support->items().split(raw.support->coords().slice(1, 1));
  const std::vector<Tensor> rows = raw.support->items().split(raw.feats);
  std::vector<fields::SkeletonField> result;
  for (std::size_t i = 0; i < rows.size(); ++i) {
    result.push_back(activated(
        layout.on_center ? FieldRows{coords[i], rows[i]} : averaged_corners(coords[i], rows[i], layout), layout));
  }
  return result;
}

}  // namespace anigen::models
