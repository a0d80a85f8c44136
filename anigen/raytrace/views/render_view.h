#pragma once
#include <Eigen/Core>
#include <cstdint>
#include <memory>
#include <vector>

#include "anigen/io/image.h"
#include "anigen/raytrace/camera.h"
#include "anigen/raytrace/scene.h"
#include "anigen/raytrace/views/transforms_json.h"

namespace anigen::raytrace {

struct ViewOptions {
  int size = 512;            ///< pixels on a side, 1 … 16384; the published renders: 512, their conditions: 1024
  int samples_per_axis = 2;  ///< this many squared rays per pixel for what is anti-aliased (box filter), 1 … 16

  // Which channels of ViewImages to fill; the others stay empty and cost nothing.
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

}  // namespace anigen::raytrace
