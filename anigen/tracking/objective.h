#pragma once
#include <cstdint>
#include <vector>

#include "anigen/nn/torch.h"
#include "anigen/tracking/camera.h"
#include "anigen/tracking/frames.h"
#include "anigen/tracking/rig_tensors.h"

namespace anigen::tracking {

/// Weights of the objective's terms. Lengths are counted in sides of the picture, angles in radians.
struct ObjectiveWeights {
  double silhouette = 1.0;
  double color = 1.0;
  double distance = 40.0;  ///< of the two distances between silhouettes
  double rest = 0.15;      ///< towards the bind pose
  double twist = 1.0;      ///< against turns about the bone's own axis, over `rest`
  double step = 0.1;       ///< against change from frame to frame
  double bend = 0.2;       ///< against change of that change, where all frames are solved together
};

/// Light of a frame: second-order spherical harmonics, times a gain per colour channel, which hold 99 % of what a matt
/// surface reflects (Ramamoorthi and Hanrahan 2001). [9, 3] fp64.
using Light = Tensor;

/// Light that leaves colours as they are.
Light plain_light();

/// Picture of a posed rig.
struct Rendering {
  Tensor mask;   ///< [S, S]
  Tensor color;  ///< [S, S, 3]: coverage times sqrt(base colour times light)
};

/// @param vertices [V, 3], normals [C, 3] of one pose @param clip clip_positions(vertices); gradients reach it
Rendering render_rig(const RigTensors& rig, const Tensor& clip, const Tensor& normals, const Light& light,
                     std::int64_t size);

/// The light under which a pose's colours come closest to the frame, in the sense of least squares over the pixels that
/// both cover; a ridge holds what they do not determine at plain_light().
Light fit_light(const RigTensors& rig, const Tensor& clip, const Tensor& normals, const FrameLevel& frame);

/// Silhouettes and colours of a pose against a frame:
///
///   E = w_s Σ_p (M_p − α_p)² / Σ_p α_p  +  w_c Σ_p ρ(I_p − I*_p) / Σ_p α_p
///       + w_d (mean_x D(π x)² + mean_q max(0, min_x |q − π x| − r)²) / A
///
/// M, I: antialiased coverage and colour of the rendering (Laine et al. 2020, "Modular primitives for high-performance
/// differentiable rendering", whose gradient at silhouettes the first two terms use); α, I*: the frame's;
/// ρ(e) = sqrt(|e|² + ε²) − ε, which grows slowly for colours that light or the rig cannot explain; x: points spread
/// over the surface, π the projection, D the distance from the frame's silhouette, q: points spread over that
/// silhouette, A the share of the picture that it covers. The last two pull parts that have lost their overlap, where
/// the first two have no gradient (two-sided silhouette distances as in Lassner et al. 2017, "Unite the People").
/// @return scalar; differentiable once in the vertices
Tensor picture_energy(const RigTensors& rig, const Tensor& vertices, const Tensor& normals, const PinholeCamera& camera,
                      const FrameLevel& frame, const Light& light, const ObjectiveWeights& weights);

/// Σ_j (w_r |ω_j|² + w_t (ω_j · b_j)²) / (N max(10, J)) over J free joints, w_t = 0 at the root, b_j the bone's axis:
/// poses stay near the bind pose, as SMPLify's stay near those that people take (Bogo et al. 2016), and no turn is
/// invented that hardly shows.
/// @param turns [N, J, 3]
Tensor pose_energy(const RigTensors& rig, const Tensor& turns, const ObjectiveWeights& weights);

/// w (Σ_j |ω_j − ω'_j|² / max(10, J) + |s − s'|² / size²) / N. @param turns, before [N, J, 3] @param shift,
/// shift_before [N, 3]
/// @param size length in the asset's unit that counts as a radian
Tensor change_energy(const RigTensors& rig, const Tensor& turns, const Tensor& before, const Tensor& shift,
                     const Tensor& shift_before, double size, double weight);

/// Intersection over union of two coverages, soft: Σ min / Σ max. @param mask, alpha [S, S]
double overlap_of(const Tensor& mask, const Tensor& alpha);

}  // namespace anigen::tracking
