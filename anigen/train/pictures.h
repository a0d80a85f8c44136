#pragma once
#include "anigen/asset/rigged_asset.h"
#include "anigen/io/image.h"
#include "anigen/nn/torch.h"
#include "anigen/skeleton_field/field.h"

namespace anigen::train {

/// @param vertices [V, 3] @param faces [F, 3] integers, anywhere
Mesh mesh_of(const torch::Tensor& vertices, const torch::Tensor& faces);

/// Pixels on a side of the pictures below, which all show the same box, the object's cube of side 1, from the same
/// place: sizes can be compared.
inline constexpr int kRigPictureSize = 256;

/// The first three attributes of decoded vertices, which are colours of pictures (sRGB in [0, 1]), as linear vertex
/// colours; nothing where there are none. @param attributes [V, 3 or more], may be undefined
void set_vertex_colors(Mesh& mesh, const torch::Tensor& attributes);

/// An asset's mesh with a skeleton drawn over it.
io::Image picture_with_skeleton(const Asset& asset, const skeleton_field::SkeletonTensors& skeleton);

/// An asset's mesh in the colours of its joints. @param weights [V, J], anywhere
io::Image picture_with_weights(const Asset& asset, const torch::Tensor& weights);

/// Placeholder image of a sheet.
io::Image empty_rig_picture();

}  // namespace anigen::train
