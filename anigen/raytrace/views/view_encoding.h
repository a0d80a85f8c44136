#pragma once
#include <cstdint>
#include <string>
#include <vector>

#include "anigen/io/image.h"
#include "anigen/io/ndarray.h"
#include "anigen/raytrace/views/render_view.h"

namespace anigen::raytrace {

/// World normals of the pixel centres as RGB = round(255 (n + 1) / 2), alpha = mask; transparent black elsewhere.
/// @throws InputError unless the view has the channels of ViewOptions::geometry
io::Image encode_world_normals(const ViewImages& view);

/// The picture that conditions the published first stage, from true normals where the published system estimates them:
/// normals in the camera's OpenGL frame (x right, y up, z to the viewer), RGB = trunc(255 (n + 1) / 2), so that a
/// surface square to the camera is (127, 127, 255). That is the estimator's output (x right, y down, z forward,
/// pointing away from the viewer) with x negated. Averaged over each pixel; alpha is that of the colour picture of the
/// same options, transparent black elsewhere, so that cropping and masking treat both alike. (Reference
/// normal-estimator.md, "DSINE output", and training-and-data.md, conditioning mismatch in section 3.4.)
/// @param frame the one that was rendered
/// @throws InputError unless the view has mean_normal and coverage
io::Image encode_condition_normals(const ViewImages& view, const Frame& frame);

/// Depth as a 16-bit grey PNG: round(depth · kDepthUnits), 0 for the background. The published cameras stay within 11
/// world units, 16 bits reach 13.1 in steps of 0.0002.
inline constexpr double kDepthUnits = 5000.0;

/// @throws InputError without depth, or when a depth needs more than 16 bits (view_arrays holds any)
std::vector<std::uint8_t> encode_depth_png(const ViewImages& view);

/// The depths of such a picture, rows from the top, 0 for the background; its sides go to width and height.
/// @throws InputError when it cannot be decoded or is not 16-bit grey
std::vector<float> decode_depth_png(const std::vector<std::uint8_t>& bytes, const std::string& name_for_errors,
                                    int& width, int& height);

/// What the view has of `depth` f32 [S,S], `normal` f32 [S,S,3], `mask` u8 [S,S], `face` i32 [S,S] and `barycentric`
/// f32 [S,S,3], for io::write_npz.
io::NamedArrays view_arrays(const ViewImages& view);

}  // namespace anigen::raytrace
