// Orbit and dataset cameras, Hammersley directions, projection.
#include <cmath>
#include <string>

#include "anigen/core/numeric.h"
#include "anigen/render/cameras_json.h"
#include "anigen/render/dataset_views.h"
#include "tests/parity/eigen_tensors.h"
#include "tests/parity/registry.h"

namespace anigen::test {
namespace {

using render::ViewCamera;

torch::Tensor column(const std::vector<double>& values) { return torch::tensor(values, torch::kFloat64); }

void check_orbit_cameras(Fixture& fixture) {
  const Eigen::MatrixXd yaws = matrix(fixture.input("yaws")), pitches = matrix(fixture.input("pitchs"));
  const std::vector<Eigen::Vector3d> world = points(fixture.input("points"));
  const double radius = fixture.config().at("r"), fov = fixture.config().at("fov").get<double>() * kPi / 180.0;
  const double near = fixture.config().at("near"), far = fixture.config().at("far");
  std::vector<torch::Tensor> extrinsics, intrinsics, projections, uvs, depths, back;
  for (Eigen::Index i = 0; i < yaws.rows(); ++i) {
    const ViewCamera view = render::from_preview({yaws(i, 0), pitches(i, 0), radius, fov});
    const Eigen::Matrix4d extrinsic = render::extrinsics_of(render::camera_to_world(view));
    const Eigen::Matrix3d intrinsic = render::intrinsics_of(fov);
    Eigen::MatrixXd uv(world.size(), 2), depth(world.size(), 1), unprojected(world.size(), 3);
    for (std::size_t p = 0; p < world.size(); ++p) {
      const auto row = static_cast<Eigen::Index>(p);
      const Eigen::Vector3d seen = render::project(world[p], extrinsic, intrinsic);
      uv.row(row) = seen.head<2>().transpose();
      depth(row, 0) = seen.z();
      unprojected.row(row) = render::unproject(seen, extrinsic, intrinsic).transpose();
    }
    extrinsics.push_back(tensor(extrinsic));
    intrinsics.push_back(tensor(intrinsic));
    projections.push_back(tensor(render::clip_projection(intrinsic, near, far)));
    uvs.push_back(tensor(uv));
    depths.push_back(tensor(depth).reshape({-1}));
    back.push_back(tensor(unprojected));
  }
  fixture.check("extrinsics", torch::stack(extrinsics));
  fixture.check("intrinsics", torch::stack(intrinsics));
  fixture.check("projection", torch::stack(projections));
  fixture.check("uv", torch::stack(uvs));
  fixture.check("depth", torch::stack(depths));
  fixture.check("unprojected", torch::stack(back));
}

void check_frames(Fixture& fixture) {
  const torch::Tensor matrices = fixture.input("c2w");
  const Eigen::MatrixXd fovs = matrix(fixture.input("camera_angle_x"));
  std::vector<torch::Tensor> extrinsics, intrinsics;
  for (std::int64_t i = 0; i < matrices.size(0); ++i) {
    render::Frame frame;
    frame.camera_to_world = matrix(matrices[i]);
    frame.camera_angle_x = fovs(i, 0);
    extrinsics.push_back(tensor(render::extrinsics(frame)));
    intrinsics.push_back(tensor(render::intrinsics(frame)));
  }
  fixture.check("render_extrinsics", torch::stack(extrinsics));
  fixture.check("render_intrinsics", torch::stack(intrinsics));
}

torch::Tensor hammersley(std::size_t n, double offset0, double offset1, bool upper) {
  Eigen::MatrixXd angles(n, 2);
  for (std::size_t i = 0; i < n; ++i) {
    const ViewCamera view = render::hammersley_view(i, n, offset0, offset1, upper);
    angles.row(static_cast<Eigen::Index>(i)) << view.yaw, view.pitch;
  }
  return tensor(angles);
}

void run_cameras(Fixture& fixture) {
  check_orbit_cameras(fixture);
  check_frames(fixture);
  const auto views = fixture.config().at("num_views").get<std::size_t>();
  const auto offset = fixture.config().at("offset").get<std::vector<double>>();
  fixture.check("hammersley", hammersley(views, 0.0, 0.0, false));
  fixture.check("hammersley_remap", hammersley(views, 0.0, 0.0, true));
  fixture.check("hammersley_offset", hammersley(views, offset.at(0), offset.at(1), false));

  const torch::Tensor grid = fixture.expected("image_uv");
  std::vector<double> centres;
  for (const Eigen::Vector2d& uv : render::image_uv(static_cast<int>(grid.size(1)), static_cast<int>(grid.size(0)))) {
    centres.insert(centres.end(), {uv.x(), uv.y()});
  }
  fixture.check("image_uv", column(centres).reshape(grid.sizes()));

  std::vector<double> yaws, pitches, sides;
  for (const ViewCamera& view : render::preview_turn(fixture.config().at("num_frames").get<std::size_t>())) {
    yaws.push_back(view.yaw);
    pitches.push_back(view.pitch);
  }
  fixture.check("video_yaws", column(yaws));
  fixture.check("video_pitch", column(pitches));
  for (const ViewCamera& view : render::snapshot_views()) sides.push_back(view.yaw);
  fixture.check("snapshot_yaws", column(sides));
  fixture.check("snapshot_pitch", torch::full({}, render::snapshot_views().front().pitch, torch::kFloat64));
}

}  // namespace
}  // namespace anigen::test

ANIGEN_PARITY(ops_data_cameras, anigen::test::run_cameras)
