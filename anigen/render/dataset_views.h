#pragma once
#include <Eigen/Core>
#include <cstdint>
#include <memory>
#include <string>
#include <vector>

#include "anigen/io/arrays/ndarray.h"
#include "anigen/io/image.h"
#include "anigen/render/cameras_json.h"
#include "anigen/render/scene.h"

namespace anigen::render {

struct ViewOptions {
  int size = 512;            ///< pixels on a side, 1 … 16384; the published renders: 512, their conditions: 1024
  int samples_per_axis = 2;  ///< this many squared rays per pixel for what is anti-aliased (box filter), 1 … 16

  // Channels of ViewImages to fill; the others stay empty and cost nothing.
  bool color = true;
  bool mean_normal = false;
  bool geometry = false;    ///< depth, normal, mask
  bool visibility = false;  ///< face, barycentric

  bool flat_normals = false;  ///< those of the faces in place of the smooth ones
  bool shadows = true;        ///< of the key light, one ray per sample
  int occlusion_rays = 0;  ///< per sample, for the light from all around, 0 … 256; makes colours softer and grainier
};

/// A view of an object: square, rows from the top, [size²]. Colour, coverage and mean_normal are averages over the
/// pixel; the others are what the ray through the pixel's centre meets.
struct ViewImages {
  int size = 0;
  io::Image color;                           ///< lit, sRGB, straight alpha; transparent black background
  std::vector<float> coverage;               ///< share of the pixel that shows the object; with color or mean_normal
  std::vector<Eigen::Vector3f> mean_normal;  ///< unit, world frame, turned to the camera; zero where coverage is 0
  std::vector<float> depth;                  ///< along the optical axis, world units; 0: background
  std::vector<Eigen::Vector3f> normal;       ///< as mean_normal
  std::vector<std::uint8_t> mask;            ///< 1 where the object is, else 0
  std::vector<std::int32_t> face;            ///< index of the visible triangle; -1: background
  std::vector<Eigen::Vector3f> barycentric;  ///< of the triangle's corners; zero: background
};

/// The camera of a frame for square pictures of that many pixels on a side.
Camera view_camera(const Frame& frame, int size);

/// Takes pictures of one object from many cameras: decodes its textures once. Both sides of every face are visible;
/// what a base colour texture makes transparent (alpha below `alpha_cutoff`) is passed through, see Cutout. Lights are
/// dataset_lights(). Thread-safe; the same bytes whatever the number of threads.
class ViewRenderer {
 public:
  /// @param scene must outlive the renderer
  /// @throws InputError when a material or texture is malformed, or alpha_cutoff is outside [0, 1]
  explicit ViewRenderer(const Scene& scene, float alpha_cutoff = 0.5f);
  ~ViewRenderer();
  ViewRenderer(ViewRenderer&&) noexcept;
  ViewRenderer& operator=(ViewRenderer&&) noexcept;

  /// @throws InputError when an option is out of range or the frame's field of view or matrix is unusable
  ViewImages render(const Frame& frame, const ViewOptions& options = {}) const;

 private:
  struct Implementation;
  std::unique_ptr<Implementation> implementation_;
};

/// One view of a scene; for many, keep a ViewRenderer.
ViewImages render_view(const Scene& scene, const Frame& frame, const ViewOptions& options = {});

/// The cameras of the published previews and training snapshots. They measure yaw from +Y towards +X, so that the eye
/// is at radius · (sin yaw cos pitch, cos yaw cos pitch, sin pitch): the angles returned here are those. Pass them
/// through from_preview() before anything else of this folder sees them. (docs/reference/training.md, 1.1.)
ViewCamera from_preview(const ViewCamera& preview);

/// One turn with the camera rising and sinking: yaw from 0 to 2 · 3.1415 (the published constant), both ends included,
/// pitch 0.25 + 0.5 sin(yaw); radius 2, field of view 40°. @throws InputError when frames is 0
std::vector<ViewCamera> preview_turn(std::size_t frames);

/// Four sides from slightly above: yaw −16°, 74°, 164°, 254°, pitch 20°; radius 2, field of view 40°.
std::vector<ViewCamera> snapshot_views();

/// World normals of the pixel centres as RGB = round(255 (n + 1) / 2), alpha = mask; transparent black elsewhere.
/// @throws InputError unless the view has the channels of ViewOptions::geometry
io::Image encode_world_normals(const ViewImages& view);

/// The picture that conditions the published first stage, from true normals where the published system estimates them:
/// normals in the camera's OpenGL frame (x right, y up, z to the viewer), RGB = trunc(255 (n + 1) / 2), so that a
/// surface square to the camera is (127, 127, 255). That is the estimator's output (x right, y down, z forward,
/// pointing away from the viewer) with x negated. Averaged over each pixel; alpha is that of the colour picture of the
/// same options, transparent black elsewhere, so that cropping and masking treat both alike.
/// (docs/reference/normals.md, 8, and docs/reference/training.md, 3.6.)
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

/// Channels of a view: `depth` f32 [S,S], `normal` f32 [S,S,3], `mask` u8 [S,S], `face` i32 [S,S] and `barycentric`
/// f32 [S,S,3], for io::write_npz.
io::NamedArrays view_arrays(const ViewImages& view);

}  // namespace anigen::render
