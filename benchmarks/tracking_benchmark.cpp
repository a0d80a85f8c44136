// Poses tracked in rendered videos against the motions that made them: built-in motions of public rigs, seen by one
// known camera from the front's side, beginning in the bind pose, from which six frames lead into the motion. Writes
// clips.csv, table.md and sheet.png.
//   benchmark_tracking FOLDER [--assets=DIR] [--rigs=DIR] [--only=RIG] [--resolution=N] [--frames=N]
#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <cstdio>
#include <map>
#include <string>
#include <vector>

#include "anigen/core/error.h"
#include "anigen/core/files.h"
#include "anigen/core/openblas.h"
#include "anigen/core/table.h"
#include "anigen/core/text.h"
#include "anigen/io/gltf/gltf.h"
#include "anigen/io/image_resize.h"
#include "anigen/motions/built_in.h"
#include "anigen/nn/profile.h"
#include "anigen/render/contact_sheet.h"
#include "anigen/render/dataset_views.h"
#include "anigen/render/picture.h"
#include "anigen/tracking/preview.h"

namespace {

using namespace anigen;
namespace fs = std::filesystem;

constexpr double kDegree = 3.14159265358979323846 / 180.0;
constexpr double kYaw = 55.0, kPitch = 10.0;  // of the camera, degrees from the front
constexpr double kFps = 24.0, kLeadIn = 6.0;  // frames
constexpr int kTileSide = 104;
constexpr int kFrameSide = 192;  // pixels
constexpr double kMoves = 5.0;   // degrees by which a joint that moves turns in some frame

struct Case {
  const char* file;  // A: below --assets, R: below --rigs
  const char* motion;
};

constexpr Case kCases[] = {
    {"A:rigged/humanoid/cesium_man.gltf", "walk"},
    {"A:rigged/humanoid/kaykit_knight.glb", "wave"},
    {"A:rigged/humanoid/q_men_adventurer.glb", "dance"},
    {"A:rigged/quadruped/q_horse.glb", "run"},
    {"R:mesh2motion_fox.glb", "walk"},
    {"A:rigged/fish/q_goldfish.glb", "swim"},
    {"R:mesh2motion_snake.glb", "slither"},
    {"A:rigged/arthropod/q_spider.glb", "walk"},
    {"A:rigged/reptile_dragon/q_monster_dragon.glb", "fly"},
    {"R:mesh2motion_kaiju.glb", "jump"},
};

struct Mean {
  std::vector<double> values;
  double mean() const {
    double sum = 0.0;
    for (const double value : values) sum += value;
    return values.empty() ? 0.0 : sum / static_cast<double>(values.size());
  }
  double median() const {
    std::vector<double> sorted = values;
    std::sort(sorted.begin(), sorted.end());
    return sorted.empty() ? 0.0 : sorted[sorted.size() / 2];
  }
};

struct Outcome {
  std::string name, motion;
  std::size_t joints = 0, vertices = 0, frames = 0, moving = 0;
  Mean tracked, rest, previous;          // angles between local rotations, degrees
  Mean direction, direction_in_picture;  // angles between bones, in space and in the picture, degrees
  Mean direction_rest, rest_in_picture;
  double overlap = 0.0, overlap_rest = 0.0, seconds_per_frame = 0.0;
  std::vector<render::Tile> tiles;
};

double degrees_between(const Eigen::Vector3d& a, const Eigen::Vector3d& b) {
  return std::atan2(a.cross(b).norm(), a.dot(b)) / kDegree;
}

/// Bones from a joint to its children: world directions, and those that the camera sees.
void compare_bones(const Skeleton& skeleton, const std::vector<bool>& moves, const Pose& truth, const Pose& bind,
                   const Pose& found, const tracking::PinholeCamera& camera, Outcome& outcome) {
  const auto world = [&](const Pose& pose) { return forward_kinematics(skeleton.parents, pose); };
  const auto wanted = world(truth), here = world(found), still = world(bind);
  const auto bone = [&](const std::vector<Eigen::Matrix4d>& joints, std::size_t j) -> Eigen::Vector3d {
    const auto parent = static_cast<std::size_t>(skeleton.parents[j]);
    return joints[j].topRightCorner<3, 1>() - joints[parent].topRightCorner<3, 1>();
  };
  const Eigen::Matrix3d view = camera.world_to_camera.topLeftCorner<3, 3>();
  for (std::size_t j = 1; j < skeleton.size(); ++j) {
    if (!moves[static_cast<std::size_t>(skeleton.parents[j])]) continue;
    const Eigen::Vector3d a = bone(wanted, j), b = bone(here, j), c = bone(still, j);
    if (a.norm() < 1e-3) continue;
    outcome.direction.values.push_back(degrees_between(a, b));
    outcome.direction_rest.values.push_back(degrees_between(a, c));
    const auto flat = [&](const Eigen::Vector3d& bone) {
      return Eigen::Vector3d((view * bone).x(), (view * bone).y(), 0.0);
    };
    if (flat(a).norm() < 0.3 * a.norm()) continue;  // a bone towards the camera has no direction there
    outcome.rest_in_picture.values.push_back(degrees_between(flat(a), flat(c)));
    outcome.direction_in_picture.values.push_back(degrees_between(flat(a), flat(b)));
  }
}

/// Weights of the objective by name, and the numbers of iterations.
void set_weights(const std::map<std::string, double>& weights, tracking::TrackOptions& settings) {
  tracking::ObjectiveWeights& w = settings.weights;
  const std::map<std::string, double*> numbers = {
      {"silhouette", &w.silhouette}, {"color", &w.color}, {"distance", &w.distance}, {"rest", &w.rest},
      {"twist", &w.twist},           {"step", &w.step},   {"bend", &w.bend},         {"rate", &settings.rate}};
  const std::map<std::string, int*> counts = {
      {"first", &settings.first_iterations}, {"each", &settings.iterations}, {"together", &settings.joint_iterations}};
  for (const auto& [name, value] : weights) {
    if (numbers.count(name) > 0) {
      *numbers.at(name) = value;
    } else if (counts.count(name) > 0) {
      *counts.at(name) = static_cast<int>(value);
    } else {
      throw InputError("", "--weight-" + name, "is no weight");
    }
  }
}

/// The camera's field of view in which every pose shows as large as it can.
double fitted_fov(const Asset& asset, const std::vector<Pose>& poses, const render::ViewCamera& view) {
  const render::Frame frame = render::make_frame(view, "0.png");
  const Eigen::Matrix4d extrinsics = render::extrinsics(frame);
  double widest = 0.0;  // tangent
  for (const Pose& pose : poses) {
    for (const Eigen::Vector3f& vertex : skin_vertices(asset, pose)) {
      const Eigen::Vector3d seen = (extrinsics * vertex.cast<double>().homogeneous()).head<3>();
      widest = std::max(widest, std::max(std::abs(seen.x()), std::abs(seen.y())) / seen.z());
    }
  }
  return 2.0 * std::atan(1.05 * widest);
}

Outcome run(const Case& one, const fs::path& file, std::int64_t resolution, int frame_count,
            const std::map<std::string, double>& weights) {
  Outcome outcome;
  outcome.name = file.stem().string();
  outcome.motion = one.motion;
  Asset asset = io::read_gltf(file).asset;
  asset.name = outcome.name;
  const motions::Body body = motions::analyse(asset);
  motions::MotionOptions options;
  options.fps = kFps;
  const Animation clip = motions::to_clip(motions::make_motion(body, one.motion, options), asset.skeleton);
  asset.animations = {clip};
  normalize(asset);
  const auto frames = static_cast<std::size_t>(frame_count);
  const Pose bind = bind_pose(asset.skeleton);
  std::vector<Pose> truth;
  for (std::size_t n = 0; n < frames; ++n) {
    const double time = std::fmod(static_cast<double>(n) / kFps, std::max(clip.duration(), 1.0 / kFps));
    Pose pose = sample(asset.animations.front(), asset.skeleton, time);
    const double share = std::min(1.0, static_cast<double>(n) / kLeadIn);
    for (std::size_t j = 0; j < pose.size(); ++j) {
      pose[j].rotation = bind[j].rotation.slerp(share, pose[j].rotation);
      pose[j].translation = bind[j].translation + share * (pose[j].translation - bind[j].translation);
    }
    truth.push_back(std::move(pose));
  }
  render::ViewCamera view;
  view.yaw = (kYaw - 90.0) * kDegree;
  view.pitch = kPitch * kDegree;
  view.radius = 2.5;
  view.fov = render::kFeatureFov;
  view.fov = fitted_fov(asset, truth, view);
  const render::Frame frame = render::make_frame(view, "000.png");
  const tracking::PinholeCamera camera = tracking::pinhole(frame);
  std::vector<tracking::TrackedFrame> video;
  render::ViewOptions look;
  look.size = kFrameSide;
  for (const Pose& pose : truth) {
    const render::Scene scene(asset, skin_vertices(asset, pose));
    video.push_back({render::render_view(scene, frame, look).color, "frame " + std::to_string(video.size()), camera});
  }
  const tracking::RigTensors rig = tracking::rig_tensors(asset);
  tracking::TrackOptions settings;
  settings.resolution = resolution;
  set_weights(weights, settings);
  const tracking::TrackedPoses poses = tracking::track(rig, video, settings);
  const Animation found = tracking::clip_of(poses, asset.skeleton, {}, kFps, "tracked");

  std::vector<bool> moves(asset.skeleton.size(), false);
  const auto angle = [](const Transform& a, const Transform& b) {
    return a.rotation.normalized().angularDistance(b.rotation.normalized()) / kDegree;
  };
  for (std::size_t j = 0; j < moves.size(); ++j) {
    for (const Pose& pose : truth) moves[j] = moves[j] || angle(pose[j], bind[j]) > kMoves;
    moves[j] = moves[j] && rig.is_free[static_cast<std::int64_t>(j)][0].item<double>() > 0.0;
    if (moves[j]) ++outcome.moving;
  }
  for (std::size_t n = 0; n < frames; ++n) {
    const Pose pose = sample(found, asset.skeleton, static_cast<double>(n) / kFps);
    for (std::size_t j = 0; j < moves.size(); ++j) {
      if (!moves[j]) continue;
      outcome.tracked.values.push_back(angle(truth[n][j], pose[j]));
      outcome.rest.values.push_back(angle(truth[n][j], bind[j]));
      if (n > 0) outcome.previous.values.push_back(angle(truth[n][j], truth[n - 1][j]));
    }
    compare_bones(asset.skeleton, moves, truth[n], bind, pose, camera, outcome);
  }
  for (std::size_t n = 0; n < frames; ++n) outcome.overlap += poses.overlaps[n] / static_cast<double>(frames);
  outcome.joints = asset.skeleton.size();
  outcome.vertices = static_cast<std::size_t>(rig.vertices.size(0));
  outcome.frames = frames;
  outcome.seconds_per_frame = poses.seconds / static_cast<double>(frames);

  render::PictureOptions aside;
  aside.width = aside.height = kTileSide;
  aside.view.yaw_degrees = kYaw + 90.0;
  aside.view.pitch_degrees = kPitch;
  aside.background = std::nullopt;
  Box box = bounding_box(asset.mesh.vertices);
  aside.view.fit = box;
  aside.view.margin = 1.2;
  for (const std::size_t n : {frames / 2, frames - 1}) {
    const Pose pose = sample(found, asset.skeleton, static_cast<double>(n) / kFps);
    outcome.tiles.push_back({io::resize_lanczos(video[n].image, kTileSide, kTileSide, io::ResizeAlpha::kPremultiplied),
                             n == frames / 2 ? outcome.name + ", " + outcome.motion : ""});
    outcome.tiles.push_back({tracking::tracked_picture(rig, poses, n, camera, kTileSide), "tracked"});
    render::set_pose(aside, asset, truth[n]);
    outcome.tiles.push_back({render::render(asset, aside), "true, side"});
    render::set_pose(aside, asset, pose);
    outcome.tiles.push_back({render::render(asset, aside), "tracked, side"});
  }
  return outcome;
}

std::string number(double value, const char* format = "%.1f") {
  char text[32];
  std::snprintf(text, sizeof text, format, value);
  return text;
}

std::vector<std::string> row_of(const Outcome& one) {
  return {one.name,
          one.motion,
          std::to_string(one.joints),
          std::to_string(one.moving),
          std::to_string(one.vertices),
          std::to_string(one.frames),
          number(one.tracked.mean()),
          number(one.tracked.median()),
          number(one.rest.mean()),
          number(one.rest.median()),
          number(one.previous.mean()),
          number(one.direction.mean()),
          number(one.direction_in_picture.mean()),
          number(one.rest_in_picture.mean()),
          number(one.direction_rest.mean()),
          number(one.overlap, "%.3f"),
          number(one.seconds_per_frame, "%.2f")};
}

}  // namespace

int main(int argc, char** argv) {
  anigen::start_with_openblas_core(argv);  // as the programs do
  std::map<std::string, std::string> given = {{"assets", "../shared/assets"},
                                              {"rigs", "../shared/rigs"},
                                              {"only", ""},
                                              {"resolution", "128"},
                                              {"frames", "12"}};
  std::map<std::string, double> weights;
  fs::path folder;
  for (int i = 1; i < argc; ++i) {
    const std::string word = argv[i];
    const std::size_t equals = word.find('=');
    if (word.rfind("--", 0) != 0) {
      folder = word;
    } else if (equals != std::string::npos && word.rfind("--weight-", 0) == 0) {
      weights[word.substr(9, equals - 9)] = std::stod(word.substr(equals + 1));
    } else if (equals != std::string::npos && given.count(word.substr(2, equals - 2)) > 0) {
      given[word.substr(2, equals - 2)] = word.substr(equals + 1);
    } else {
      std::fprintf(stderr, "unknown option %s\n", word.c_str());
      return 2;
    }
  }
  if (folder.empty()) {
    std::fprintf(stderr,
                 "benchmark_tracking FOLDER [--assets=DIR] [--rigs=DIR] [--only=RIG] [--resolution=N] [--frames=N]\n");
    return 2;
  }
  try {
    nn::set_up_computing(1);
    CsvTable table;
    table.columns = {"rig",      "motion",        "joints",     "moving",      "vertices",   "frames",
                     "error",    "median",        "rest",       "rest_median", "previous",   "bones",
                     "bones_2d", "bones_2d_rest", "bones_rest", "overlap",     "s_per_frame"};
    Mean all, all_rest, all_previous, bones, bones_picture, bones_picture_rest, bones_rest, overlap, seconds;
    std::vector<render::Tile> tiles;
    for (const Case& one : kCases) {
      const std::string name = one.file;
      const fs::path file = fs::path(given[name[0] == 'A' ? "assets" : "rigs"]) / name.substr(2);
      if (!given["only"].empty() && file.stem().string() != given["only"]) continue;
      const Outcome outcome = run(one, file, std::stoll(given["resolution"]), std::stoi(given["frames"]), weights);
      table.rows.push_back(row_of(outcome));
      std::fprintf(stderr, "%s\n", joined(table.rows.back(), " ").c_str());
      const auto append = [](Mean& to, const Mean& from) {
        to.values.insert(to.values.end(), from.values.begin(), from.values.end());
      };
      append(all, outcome.tracked);
      append(all_rest, outcome.rest);
      append(all_previous, outcome.previous);
      append(bones, outcome.direction);
      append(bones_picture, outcome.direction_in_picture);
      append(bones_picture_rest, outcome.rest_in_picture);
      append(bones_rest, outcome.direction_rest);
      overlap.values.push_back(outcome.overlap);
      seconds.values.push_back(outcome.seconds_per_frame);
      tiles.insert(tiles.end(), outcome.tiles.begin(), outcome.tiles.end());
    }
    table.rows.push_back({"all joints and frames", "", "", "", "", "", number(all.mean()), number(all.median()),
                          number(all_rest.mean()), number(all_rest.median()), number(all_previous.mean()),
                          number(bones.mean()), number(bones_picture.mean()), number(bones_picture_rest.mean()),
                          number(bones_rest.mean()), number(overlap.mean(), "%.3f"), number(seconds.mean(), "%.2f")});
    write_file_atomically(folder / "clips.csv", to_csv(table));
    std::string text = "| " + joined(table.columns, " | ") + " |\n|";
    for (std::size_t k = 0; k < table.columns.size(); ++k) text += "---|";
    for (const std::vector<std::string>& row : table.rows) text += "\n| " + joined(row, " | ") + " |";
    write_file_atomically(folder / "table.md", text + "\n");
    render::SheetOptions sheet;
    sheet.columns = 8;
    sheet.gap = 4;
    sheet.text_height = 8;
    io::write_png(folder / "sheet.png", render::contact_sheet(tiles, sheet));
  } catch (const Error& error) {
    std::fprintf(stderr, "error: %s\n", error.what());
    return 1;
  }
  return 0;
}
