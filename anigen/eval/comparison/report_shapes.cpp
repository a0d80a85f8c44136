#include "anigen/eval/comparison/report_shapes.h"

#include <algorithm>
#include <cmath>
#include <cstring>
#include <utility>

#include "anigen/core/base64.h"
#include "anigen/eval/skeleton/joint_ties.h"
#include "anigen/eval/skin/deformation.h"
#include "anigen/geometry/bone_distance.h"
#include "anigen/raytrace/contact_sheet.h"
#include "anigen/raytrace/picture.h"
#include "anigen/raytrace/turntable.h"

namespace anigen::eval {
namespace {

template <typename T>
std::string encoded(const std::vector<T>& values) {
  std::vector<std::uint8_t> bytes(values.size() * sizeof(T));
  if (!bytes.empty()) std::memcpy(bytes.data(), values.data(), bytes.size());
  return base64(bytes);
}

/// Places are shown in the box [-1, 1], which holds the unit box and whatever a bad prediction puts next to it.
std::int16_t quantized(double x) { return static_cast<std::int16_t>(std::lround(std::clamp(x, -1.0, 1.0) * 32767.0)); }

Json shape_json(const io::RiggedShape& shape) {
  std::vector<std::int16_t> vertices;
  for (const Eigen::Vector3f& v : shape.mesh.vertices) {
    for (int axis = 0; axis < 3; ++axis) vertices.push_back(quantized(v[axis]));
  }
  std::vector<std::uint32_t> faces;
  if (shape.mesh.faces.size() <= kMostViewedFaces) {
    for (const Triangle& face : shape.mesh.faces) {
      for (const std::int32_t corner : face) faces.push_back(static_cast<std::uint32_t>(corner));
    }
  }
  std::vector<float> bones;
  if (shape.has_joints()) {
    for (const geometry::Bone& bone : geometry::bones_of(shape.joints.positions, shape.joints.parents)) {
      for (const Eigen::Vector3d& end : {bone.head, bone.tail}) {
        for (int axis = 0; axis < 3; ++axis) bones.push_back(static_cast<float>(end[axis]));
      }
    }
  }
  return {{"vertices", encoded(vertices)}, {"faces", encoded(faces)}, {"bones", encoded(bones)}};
}

/// Pictures need a mesh and a joint; what a shape lacks is not drawn.
std::vector<io::Image> views_of(const io::RiggedShape& shape, int views, int size) {
  raytrace::PictureOptions options;
  options.width = options.height = size;
  options.ambient_occlusion = false;
  options.skeleton = shape.has_joints();
  Asset asset;
  if (shape.has_joints()) {
    asset = to_asset(shape);
  } else {
    asset.mesh = shape.mesh;
    asset.materials = shape.materials;
    asset.images = shape.images;
  }
  return raytrace::turntable(asset, options, views);
}

/// The shape with other vertices, every joint a colour.
io::Image picture_of_weights(const io::RiggedShape& shape, std::vector<Eigen::Vector3f> vertices, int size) {
  Asset asset = to_asset(shape);
  asset.mesh.normals = vertex_normals(vertices, asset.mesh.faces);
  asset.mesh.vertices = std::move(vertices);
  raytrace::PictureOptions options;
  options.width = options.height = size;
  options.ambient_occlusion = false;
  options.mode = raytrace::PictureMode::kWeights;
  return raytrace::render(asset, options);
}

}  // namespace

std::string turntable_html(const ComparedShapes& shapes, int views, int size) {
  const std::vector<io::Image> left = views_of(shapes.truth, views, size);
  const std::vector<io::Image> right = views_of(shapes.predicted, views, size);
  std::vector<raytrace::Tile> tiles;
  for (std::size_t i = 0; i < left.size(); ++i) {
    tiles.push_back({left[i], ""});
    tiles.push_back({right[i], ""});
  }
  raytrace::SheetOptions sheet;
  sheet.columns = 2;
  sheet.gap = 0;
  const std::string strip = base64(io::encode_png(raytrace::contact_sheet(tiles, sheet)));
  return "<div class=\"turn\" data-views=\"" + std::to_string(views) + "\" style=\"width:" + std::to_string(2 * size) +
         "px;height:" + std::to_string(size) + "px;background-image:url(data:image/png;base64," + strip +
         ")\"></div><div class=\"hint\">left: ground truth, right: prediction; drag to turn</div>\n";
}

std::string posed_html(const ComparedShapes& shapes, int poses, int size, std::uint64_t seed) {
  for (const io::RiggedShape* shape : {&shapes.truth, &shapes.predicted}) {
    if (!shape->has_skin() || !shape->has_surface()) return "";
  }
  const Eigen::MatrixXd plan = matching_plan(shapes.predicted.joints, shapes.truth.joints);
  DeformationOptions options;
  options.seed = seed;
  std::vector<raytrace::Tile> tiles;
  for (int pose = 0; pose < poses; ++pose) {
    PosedPair posed = posed_pair(shapes.truth, shapes.predicted, plan, pose, options);
    tiles.push_back({picture_of_weights(shapes.truth, std::move(posed.truth), size), ""});
    tiles.push_back({picture_of_weights(shapes.predicted, std::move(posed.predicted), size), ""});
  }
  raytrace::SheetOptions sheet;
  sheet.columns = 2 * poses;
  sheet.gap = 0;
  constexpr int kQuality = 85;
  const std::vector<std::uint8_t> strip = io::encode_jpeg(raytrace::contact_sheet(tiles, sheet), kQuality);
  return "<img style=\"max-width:100%\" alt=\"poses\" src=\"data:image/jpeg;base64," + base64(strip) +
         "\"><div class=\"hint\">the same random poses, each in the colours of its own joints: ground truth, "
         "prediction, ground truth, "
         "…</div>\n";
}

std::string view_html(const ComparedShapes& shapes, const std::string& id) {
  const Json data = Json::array({shape_json(shapes.truth), shape_json(shapes.predicted)});
  return "<script type=\"application/json\" id=\"" + id + "\">" + data.dump() +
         "</script><button onclick=\"open3d(this)\" data-shape=\"" + id + "\">3D view</button>\n";
}

}  // namespace anigen::eval
