#pragma once
#include <Eigen/Core>
#include <optional>
#include <vector>

#include "anigen/asset/mesh.h"
#include "anigen/asset/rigged_asset.h"
#include "anigen/asset/skin_weights.h"
#include "anigen/io/image.h"
#include "anigen/render/scene.h"

namespace anigen::render {

/// A colour per joint (sRGB in [0, 1]) that depends on the index only, so that a joint keeps its colour across
/// pictures. Hues step by the golden ratio, which sets neighbours far apart, at lightnesses that alternate; both are
/// those of OKLab (Ottosson 2020), in which no hue looks darker than another.
Eigen::Vector3f joint_color(int joint);

/// Dark blue over teal and yellow to red for values in [0, 1] (sRGB); others are clamped.
Eigen::Vector3f heat_color(float value);

/// Σ_j w_vj · joint_color(j) per vertex (sRGB); grey for an empty row.
std::vector<Eigen::Vector3f> weight_colors(const SkinWeights& weights);

/// heat_color(Σ_{j in joints} w_vj) per vertex (sRGB).
std::vector<Eigen::Vector3f> heat_colors(const SkinWeights& weights, const std::vector<int>& joints);

struct OverlayStyle {
  Eigen::Vector3f bone{1.0f, 0.62f, 0.16f};  ///< sRGB
  Eigen::Vector3f joint{1.0f, 0.97f, 0.90f};
  Eigen::Vector3f outline{0.10f, 0.11f, 0.14f};
  bool color_by_joint = false;  ///< bones in the colours that weight pictures give their child joints
  double thickness = 1.0;       ///< factor on the sizes, which follow the picture's
};

/// Draws bones as tapered capsules, thick at the parent, and joints as dots, over the picture: anti-aliased, with a
/// dark rim so that they show on light and on dark; far ones first. Joints behind the camera are left out.
/// @param positions,parents [J] world frame; parent -1 for a root
/// @param shown [J], or empty for all: joints that are not shown are left out and bones go on to the next ancestor
/// @throws InputError when lengths differ, a parent is out of range or a position is not finite
void draw_skeleton(io::Image& image, const Camera& camera, const std::vector<Eigen::Vector3d>& positions,
                   const std::vector<int>& parents, const OverlayStyle& style = {},
                   const std::vector<bool>& shown = {});

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

/// As above, for a scene that is already set up; options.vertices is ignored.
io::Image render(const Scene& scene, const PictureOptions& options);

/// The camera render() uses.
Camera picture_camera(const Scene& scene, const PictureOptions& options);

/// Puts a pose's vertices and joints into the options.
void set_pose(PictureOptions& options, const Asset& asset, const Pose& pose);

/// Vertex normals of a mesh whose vertices moved: every normal of the file is turned as its vertex' surrounding
/// faces turned, which keeps hard and soft edges as the author set them. Without normals in the file: area-weighted.
std::vector<Eigen::Vector3f> posed_normals(const Mesh& mesh, const std::vector<Eigen::Vector3f>& vertices);

/// `views` pictures at equal yaw steps around the asset, starting at options.view.yaw_degrees. The camera keeps one
/// distance, at which every view fits, so that the object does not pulsate.
/// @throws InputError when views is not in 1 … 3600, and as render()
std::vector<io::Image> turntable(const Asset& asset, const PictureOptions& options, int views);

}  // namespace anigen::render
