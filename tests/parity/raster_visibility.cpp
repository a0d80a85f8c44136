// Visibility by the ray tracer against the rasteriser's outputs before antialiasing. Pixels that the fixture marks as
// too close to call (a centre on a projected edge, two surfaces at one depth) take the expected value.
#include "tests/parity/raster_visibility.h"

#include <Eigen/LU>
#include <cmath>
#include <string>
#include <vector>

#include "anigen/render/cameras_json.h"
#include "anigen/render/dataset_views.h"
#include "anigen/render/scene.h"
#include "tests/parity/eigen_tensors.h"

namespace anigen::test {
namespace {

// The limits that the fixture's tolerance note states for an implementation with exact coverage.
constexpr double kRayEdgeDistance = 1e-3, kRayDepthGap = 1e-5;

Asset mesh_asset(Fixture& fixture, const std::string& mesh) {
  Asset asset;
  asset.name = mesh;
  for (const Eigen::Vector3d& vertex : points(fixture.input(mesh + ".vertices")))
    asset.mesh.vertices.push_back(vertex.cast<float>());
  const std::vector<int> flat = ints(fixture.input(mesh + ".faces"));
  for (std::size_t i = 0; i + 2 < flat.size(); i += 3) asset.mesh.faces.push_back({flat[i], flat[i + 1], flat[i + 2]});
  return asset;
}

render::Frame frame_of(const Eigen::Matrix4d& extrinsics, const Eigen::Matrix3d& intrinsics) {
  render::Frame frame;
  frame.camera_angle_x = 2.0 * std::atan(0.5 / intrinsics(0, 0));
  frame.camera_to_world = extrinsics.inverse();
  frame.camera_to_world.topRows<3>().col(1) *= -1.0;
  frame.camera_to_world.topRows<3>().col(2) *= -1.0;
  return frame;
}

}  // namespace

void check_ray_traced_visibility(Fixture& fixture, const std::string& mesh) {
  const Asset asset = mesh_asset(fixture, mesh);
  const Eigen::Matrix4d extrinsics = matrix(fixture.input(mesh + ".extrinsics"));
  const Eigen::Matrix3d intrinsics = matrix(fixture.input(mesh + ".intrinsics"));
  const Eigen::Matrix4d clip =
      render::clip_projection(intrinsics, fixture.config().at("near"), fixture.config().at("far"));
  Eigen::MatrixXd corners(asset.mesh.vertices.size(), 4);
  for (std::size_t v = 0; v < asset.mesh.vertices.size(); ++v) {
    const Eigen::Vector4d point = asset.mesh.vertices[v].cast<double>().homogeneous();
    corners.row(static_cast<Eigen::Index>(v)) = (clip * extrinsics * point).transpose();
  }
  fixture.check(mesh + ".clip", tensor(corners));

  const render::Scene scene(asset);
  render::ViewOptions options;
  options.size = fixture.config().at("resolution");
  options.color = false;
  options.geometry = options.visibility = options.flat_normals = true;
  const render::Frame frame = frame_of(extrinsics, intrinsics);
  const render::ViewImages view = render::render_view(scene, frame, options);

  const auto copy = [&](const std::string& name) {
    return fixture.expected(mesh + "." + name).to(torch::kFloat64).contiguous().clone();
  };
  torch::Tensor triangle = copy("triangle"), bary = copy("bary"), depth_ratio = copy("zw"), depth = copy("depth_raw");
  torch::Tensor normal = copy("normal_raw"), face_normal = copy("face_normal");
  const torch::Tensor edge = copy("edge_distance"), gap = copy("z_gap");
  std::size_t compared = 0, masks = 0;
  for (std::size_t i = 0; i < view.face.size(); ++i) {
    if (!(edge.data_ptr<double>()[i] > kRayEdgeDistance && gap.data_ptr<double>()[i] > kRayDepthGap)) continue;
    ++compared;
    const bool hit = view.face[i] >= 0;
    masks += hit == (view.mask[i] != 0) ? 1 : 0;
    triangle.data_ptr<double>()[i] = view.face[i];
    depth.data_ptr<double>()[i] = view.depth[i];
    depth_ratio.data_ptr<double>()[i] = hit ? clip(2, 2) + clip(2, 3) / static_cast<double>(view.depth[i]) : 0.0;
    Eigen::Vector3f outward = view.normal[i];
    if (hit) {
      // Ours is turned to the camera, theirs follows the winding.
      const Triangle& face = asset.mesh.faces[static_cast<std::size_t>(view.face[i])];
      const auto corner = [&](std::size_t k) { return asset.mesh.vertices[static_cast<std::size_t>(face[k])]; };
      const Eigen::Vector3f winding = (corner(1) - corner(0)).cross(corner(2) - corner(0));
      if (winding.dot(outward) < 0.0f) outward = -outward;
    }
    for (std::size_t k = 0; k < 3; ++k) {
      const double value = outward[static_cast<Eigen::Index>(k)];
      normal.data_ptr<double>()[3 * i + k] = value;
      if (hit) face_normal.data_ptr<double>()[3 * static_cast<std::size_t>(view.face[i]) + k] = value;
      if (k < 2) bary.data_ptr<double>()[2 * i + k] = view.barycentric[i][static_cast<Eigen::Index>(k)];
    }
  }
  fixture.check_true(mesh + ": " + std::to_string(compared) + " of " + std::to_string(view.face.size()) +
                         " pixels are not on a knife edge",
                     100 * compared >= 95 * view.face.size());
  fixture.check_true(mesh + ": the mask is where a triangle is", masks == compared);
  fixture.check(mesh + ".triangle", triangle);
  fixture.check(mesh + ".bary", bary);
  fixture.check(mesh + ".zw", depth_ratio);
  fixture.check(mesh + ".depth_raw", depth);
  fixture.check(mesh + ".normal_raw", normal);
  fixture.check(mesh + ".face_normal", face_normal);
}

}  // namespace anigen::test
