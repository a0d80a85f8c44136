#pragma once
#include <Eigen/Core>
#include <optional>
#include <vector>

#include "anigen/asset/asset.h"
#include "anigen/io/image.h"
#include "anigen/raytrace/camera.h"
#include "anigen/raytrace/scene.h"
#include "anigen/raytrace/skeleton_overlay.h"

namespace anigen::raytrace {

enum class PictureMode {
  kColor,    ///< texture × factor × vertex colour under soft light; alpha is ignored
  kNormals,  ///< smooth world normals as 0.5 + 0.5 n, unlit; both sides turned towards the viewer
  kWeights   ///< Σ_j w_vj · joint_color(j), or a heat map of `heat_joints`
};

struct PictureOptions {
  PictureMode mode = PictureMode::kColor;
  int width = 512, height = 512;  ///< pixels, 1 … 16384
  int samples_per_axis = 2;       ///< anti-aliasing: this many squared rays per pixel, 1 … 16
  Orbit view;

  std::optional<Eigen::Vector3f> background = Eigen::Vector3f(0.93f, 0.94f, 0.95f);  ///< sRGB; nullopt: transparent
  bool ambient_occlusion = true;
  bool shadows = true;         ///< of the key light on the object itself
  bool ground_shadow = false;  ///< on an invisible floor under the object; not in kNormals
  bool light_weights = true;   ///< soft light in kWeights, too; false shows the plain colours

  std::optional<std::vector<Eigen::Vector3f>> vertices;  ///< posed positions in place of the mesh's, [V]
  std::optional<SkinWeights> weights;                    ///< in place of the asset's, one row per vertex
  std::vector<int> heat_joints;                          ///< kWeights: not empty shows the sum of their weights as heat

  bool skeleton = false;                               ///< draw bones and joints over the picture
  std::optional<std::vector<Eigen::Vector3d>> joints;  ///< posed or predicted positions in place of the bind pose's
  std::optional<std::vector<int>> parents;             ///< goes with `joints` of another skeleton
  bool only_weighted_joints = false;  ///< leave out joints without any weight: controls, targets, ends of chains
  OverlayStyle skeleton_style;
};

/// A picture of an asset by ray tracing. The same bytes whatever the number of threads.
/// @throws InputError when an option is out of range, the mesh is malformed (a position that is not finite, a bad
/// index or array length), a texture cannot be decoded, or kWeights finds no weights for every vertex
io::Image render(const Asset& asset, const PictureOptions& options = {});

/// The same for a scene that is already set up; options.vertices is ignored.
io::Image render(const Scene& scene, const PictureOptions& options);

/// The camera render() uses.
Camera picture_camera(const Scene& scene, const PictureOptions& options);

/// Puts a pose's vertices and joints into the options.
void set_pose(PictureOptions& options, const Asset& asset, const Pose& pose);

}  // namespace anigen::raytrace
