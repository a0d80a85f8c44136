#pragma once
#include <cstdint>

#include "anigen/nn/torch.h"

namespace anigen::shape_field {

using torch::Tensor;

/// Largest resolution: the cubes of a finer grid could not be numbered with 63 bits.
inline constexpr std::int64_t kMostCubeResolution = 1 << 20;

/// Flexible weights of a cube: beta 12, alpha 8, gamma 1.
inline constexpr std::int64_t kCubeWeights = 21;
inline constexpr std::int64_t kRegularWeights = 20;  ///< beta and alpha, which a regulariser keeps small

/// Prediction of a decoder in one active cube of an R³ grid, one value per corner; corner k of cube c is grid vertex
/// c + o_k, x fastest: o = 000, 100, 010, 110, 001, 101, 011, 111 (docs/reference/autoencoders.md, 4.7). Values are
/// fp32 or fp64, all of one type and on one device.
struct CubeCorners {
  Tensor coords;      ///< [C, 3] integers in [0, R), no cube twice, any order
  Tensor sdf;         ///< [C, 8], bias already added
  Tensor deform;      ///< [C, 8, 3], raw
  Tensor attributes;  ///< [C, 8, A], activated
  Tensor weights;     ///< [C, 21], raw: beta 12, alpha 8, gamma 1
};

/// The field on the grid vertices that active cubes touch: sorted by x, y, z, each the mean over the corners that touch
/// it. Everywhere else sdf is +1, attributes and deformation 0, and cubes have weights 0
/// (docs/reference/autoencoders.md, 5.1).
struct CubeField {
  std::int64_t resolution = 0;  ///< R
  Tensor vertices;              ///< [V, 3] int32 in [0, R]
  Tensor sdf;                   ///< [V]
  Tensor deform;                ///< [V, 3], raw
  Tensor attributes;            ///< [V, A]
  Tensor coords;                ///< [C, 3] active cubes
  Tensor corner_vertices;       ///< [C, 8] int64, row of `vertices` of each corner
  Tensor weights;               ///< [C, 21], raw

  /// v/R − 0.5, where the vertices stand before they are deformed. @return [V, 3]
  Tensor grid_positions() const;
  /// v/R − 0.5 + (1 − 1e-8)/(2R) · tanh(deform). @return [V, 3]
  Tensor positions() const;
};

/// Positions of grid vertices in the type and on the device of another tensor: deformed or, with an undefined `deform`,
/// not. @param places [V, 3] integers @param deform [V, 3] raw
Tensor vertex_positions(const Tensor& places, const Tensor& deform, std::int64_t resolution, const Tensor& like);

/// Differentiable in everything but coords. No dense grid is formed: memory follows the number of cubes. Sums have one
/// order, so that results do not depend on the number of threads.
/// @throws InputError for shapes or types that do not fit, a resolution outside [1, kMostCubeResolution], a cube
/// outside the grid or twice
CubeField average_corners(const CubeCorners& corners, std::int64_t resolution);

/// mean (corner value − averaged value)² over all corners and channels [sdf, deform 3, attributes A]
/// (docs/reference/training.md, 3.3); 0 without corners. Differentiable in the corners.
/// @param field what average_corners made of these corners. The share of the gradient that passes through it is not
/// formed: it is zero, since deviations from a mean add up to nothing
Tensor corner_consistency(const CubeCorners& corners, const CubeField& field);

/// Widths of the rows that a network predicts, one per cube, docs/reference/autoencoders.md, 4.7: sdf 8, deform 8 · 3,
/// weights 21, colours 8 · colors before their sigmoid, skin features 8 · skin.
struct CornerLayout {
  std::int64_t colors = 0, skin = 0;

  std::int64_t attributes() const { return skin + colors; }
  std::int64_t channels() const { return 8 * (4 + attributes()) + kCubeWeights; }
};

struct PredictedField {
  CubeField field;        ///< attributes: skin features, then colours
  Tensor consistency;     ///< corner_consistency()
  Tensor weights_length;  ///< mean |·| of beta and alpha
};

/// average_corners() of predicted rows with its regularisers, as one differentiable operation: nothing of the size of
/// the rows is formed in between but the corners' values. CPU only.
/// @param coords [C, 3] @param feats [C, layout.channels()] fp32 or fp64 @throws InputError as average_corners()
PredictedField predicted_field(const Tensor& coords, const Tensor& feats, const CornerLayout& layout,
                               std::int64_t resolution);

}  // namespace anigen::shape_field
