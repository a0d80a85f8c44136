#pragma once
#include "anigen/fields/cube_field.h"

namespace anigen::fields {

/// Skin features of mesh vertices from the active grid vertices nearest to them, by Gaussian weights of deviation 1.5/R
/// that add up to one (reference autoencoders.md, 4.6, `vertex_skin_feat_interp_sparse`). Differentiable in the
/// features only: the weights are constants.
/// @param features [V, S] at field.vertices @param points [P, 3] object space @param count nearest vertices used
/// @param deformed measure to field.positions() instead of the undeformed grid @return [P, S]
Tensor interpolate_from_nearest(const CubeField& field, const Tensor& features, const Tensor& points,
                                std::int64_t count, bool deformed);

/// The same by trilinear interpolation in the undeformed grid, zero at vertices that no active cube touches
/// (`vertex_skin_feat_interp_trilinear`). Differentiable in features and points. @return [P, S]
Tensor interpolate_trilinearly(const CubeField& field, const Tensor& features, const Tensor& points);

}  // namespace anigen::fields
