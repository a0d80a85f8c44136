#include "anigen/render/cameras_json.h"

#include <Eigen/LU>
#include <algorithm>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <cstdio>
#include <utility>

#include "anigen/core/config.h"
#include "anigen/core/error.h"
#include "anigen/core/files.h"
#include "anigen/core/numeric.h"

namespace anigen::render {

Eigen::Matrix4d extrinsics_of(const Eigen::Matrix4d& camera_to_world) {
  Eigen::Matrix4d opencv = camera_to_world;
  opencv.topRows<3>().col(1) *= -1.0;
  opencv.topRows<3>().col(2) *= -1.0;
  Eigen::Matrix4d inverse;
  bool invertible = false;
  opencv.computeInverseWithCheck(inverse, invertible);
  if (!invertible || !inverse.allFinite())
    throw InputError("", "transform_matrix", "the camera's matrix has no inverse");
  return inverse;
}

Eigen::Matrix3d intrinsics_of(double fov) {
  if (!(fov > 0.0 && fov < kPi)) throw InputError("", "camera_angle_x", "the field of view must be between 0 and pi");
  const double focal = 0.5 / std::tan(0.5 * fov);
  Eigen::Matrix3d matrix = Eigen::Matrix3d::Identity();
  matrix(0, 0) = matrix(1, 1) = focal;
  matrix(0, 2) = matrix(1, 2) = 0.5;
  return matrix;
}

Eigen::Vector3d project(const Eigen::Vector3d& point, const Eigen::Matrix4d& extrinsics,
                        const Eigen::Matrix3d& intrinsics) {
  const Eigen::Vector3d in_camera = extrinsics.topLeftCorner<3, 3>() * point + extrinsics.topRightCorner<3, 1>();
  const Eigen::Vector3d on_plane = intrinsics * in_camera;
  return {on_plane.x() / on_plane.z(), on_plane.y() / on_plane.z(), in_camera.z()};
}

Eigen::Vector3d unproject(const Eigen::Vector3d& uv_depth, const Eigen::Matrix4d& extrinsics,
                          const Eigen::Matrix3d& intrinsics) {
  const Eigen::Vector3d on_plane(uv_depth.x() * uv_depth.z(), uv_depth.y() * uv_depth.z(), uv_depth.z());
  const Eigen::Vector3d in_camera = intrinsics.inverse() * on_plane;
  return extrinsics.topLeftCorner<3, 3>().inverse() * (in_camera - extrinsics.topRightCorner<3, 1>());
}

Eigen::Matrix4d clip_projection(const Eigen::Matrix3d& intrinsics, double near, double far) {
  if (!(near > 0.0 && far > near && std::isfinite(far)))
    throw InputError("", "near, far", "must be finite with 0 < near < far");
  Eigen::Matrix4d matrix = Eigen::Matrix4d::Zero();
  matrix(0, 0) = 2.0 * intrinsics(0, 0);
  matrix(0, 2) = 2.0 * intrinsics(0, 2) - 1.0;
  matrix(1, 1) = 2.0 * intrinsics(1, 1);
  matrix(1, 2) = 1.0 - 2.0 * intrinsics(1, 2);
  matrix(2, 2) = far / (far - near);
  matrix(2, 3) = near * far / (near - far);
  matrix(3, 2) = 1.0;
  return matrix;
}

std::vector<Eigen::Vector2d> image_uv(int width, int height) {
  if (width < 1 || height < 1) throw InputError("", "image_uv", "a picture needs pixels");
  std::vector<Eigen::Vector2d> centres;
  centres.reserve(static_cast<std::size_t>(width) * static_cast<std::size_t>(height));
  for (int y = 0; y < height; ++y) {
    for (int x = 0; x < width; ++x) centres.emplace_back((x + 0.5) / width, (y + 0.5) / height);
  }
  return centres;
}

namespace {

/// Radius of the sphere around the cube [-0.5, 0.5]³.
const double kCubeSphere = std::sqrt(3.0) / 2.0;
constexpr double kWidestFov = 70.0 * kPi / 180.0, kNarrowestFov = 10.0 * kPi / 180.0;

/// The binary digits of i mirrored at the point (Van der Corput, base 2).
double radical_inverse(std::uint64_t i) {
  double result = 0.0;
  for (double digit = 0.5; i > 0; i >>= 1, digit *= 0.5) {
    if (i & 1) result += digit;
  }
  return result;
}

void require_views(std::size_t n) {
  if (n == 0) throw InputError("", "views", "there must be at least one view");
}

constexpr std::size_t kMostFrames = 100'000;
constexpr std::uintmax_t kLargestFile = std::uintmax_t{256} << 20;
constexpr double kLargestNumber = 1e6;  ///< far outside any object of size 1
constexpr double kRigid = 1e-3;         ///< single-precision writers round to 1e-6

/// Place of a value in the file, for messages.
struct Place {
  const std::string& file;
  std::string pointer;

  Place at(const std::string& key) const { return {file, pointer + "/" + key}; }
  Place at(std::size_t index) const { return at(std::to_string(index)); }
  [[noreturn]] void refuse(const std::string& problem) const { throw InputError(file, pointer, problem); }
};

double number(const Json& value, const Place& place) {
  if (!value.is_number()) place.refuse(std::string("expected a number, found ") + value.type_name());
  return value.get<double>();  // finite: the parser refuses the rest
}

const Json& list(const Json& value, std::size_t size, const Place& place) {
  if (!value.is_array() || value.size() != size) {
    place.refuse("expected a list of " + std::to_string(size) + ", found " +
                 (value.is_array() ? "one of " + std::to_string(value.size()) : value.type_name()));
  }
  return value;
}

Eigen::Vector3d vector3(const Json& value, const Place& place) {
  list(value, 3, place);
  Eigen::Vector3d result;
  for (std::size_t i = 0; i < 3; ++i) result[static_cast<Eigen::Index>(i)] = number(value[i], place.at(i));
  return result;
}

void check_matrix(const Eigen::Matrix4d& matrix, const Place& place) {
  if (!matrix.allFinite() || matrix.cwiseAbs().maxCoeff() > kLargestNumber)
    place.refuse("the matrix is not finite or beyond 1e6");
  const Eigen::Matrix3d rotation = matrix.topLeftCorner<3, 3>();
  const double skew = (rotation.transpose() * rotation - Eigen::Matrix3d::Identity()).cwiseAbs().maxCoeff();
  const double last = (matrix.row(3) - Eigen::RowVector4d(0, 0, 0, 1)).cwiseAbs().maxCoeff();
  if (!(skew <= kRigid) || !(last <= kRigid) || rotation.determinant() < 0.0)
    place.refuse("the matrix is not a rigid motion (a rotation and a position, last row 0 0 0 1)");
}

Eigen::Matrix4d matrix4(const Json& value, const Place& place) {
  list(value, 4, place);
  Eigen::Matrix4d result;
  for (std::size_t r = 0; r < 4; ++r) {
    list(value[r], 4, place.at(r));
    for (std::size_t c = 0; c < 4; ++c)
      result(static_cast<Eigen::Index>(r), static_cast<Eigen::Index>(c)) = number(value[r][c], place.at(r).at(c));
  }
  check_matrix(result, place);
  return result;
}

void check_fov(double fov, const Place& place) {
  if (!(fov > 0.0 && fov < kPi)) place.refuse("the field of view must be between 0 and pi");
}

/// A picture must lie in the folder of its transforms.json, whoever wrote that.
void check_file_path(const std::string& text, const Place& place) {
  if (text.empty() || text.size() > 1024) place.refuse("a file name is needed here");
  for (const char c : text) {
    if (static_cast<unsigned char>(c) < 0x20 || c == '\\' || c == ':')
      place.refuse("the file name has a character that is not allowed");
  }
  const std::filesystem::path path(text);
  if (path.is_absolute()) place.refuse("the file name must be relative to the folder of this file");
  for (const std::filesystem::path& part : path) {
    if (part == "..") place.refuse("the file name must not leave the folder of this file");
  }
}

void check_transforms(const Transforms& transforms, const Place& top) {
  if (transforms.frames.empty()) top.at("frames").refuse("there is no frame");
  if (transforms.frames.size() > kMostFrames) top.at("frames").refuse("more than 100000 frames");
  const bool box_finite = transforms.aabb.low.allFinite() && transforms.aabb.high.allFinite();
  if (!box_finite || !(transforms.aabb.low.array() <= transforms.aabb.high.array()).all())
    top.at("aabb").refuse("must be finite, and the lower corner must not exceed the upper one");
  if (!(transforms.scale > 0.0 && std::isfinite(transforms.scale))) top.at("scale").refuse("must be positive");
  if (!transforms.offset.allFinite()) top.at("offset").refuse("must be finite");
  for (std::size_t i = 0; i < transforms.frames.size(); ++i) {
    const Frame& frame = transforms.frames[i];
    const Place place = top.at("frames").at(i);
    check_file_path(frame.file_path, place.at("file_path"));
    check_fov(frame.camera_angle_x, place.at("camera_angle_x"));
    check_matrix(frame.camera_to_world, place.at("transform_matrix"));
  }
}

const Json& member(const Json& object, const char* key, const Place& place) {
  if (!object.is_object()) place.refuse(std::string("expected an object, found ") + object.type_name());
  const auto found = object.find(key);
  if (found == object.end()) place.refuse(std::string("the key '") + key + "' is missing");
  return *found;
}

Json json_vector(const Eigen::Vector3d& v) { return Json::array({v.x(), v.y(), v.z()}); }

Json json_frame(const Frame& frame) {
  Json matrix = Json::array();
  for (Eigen::Index r = 0; r < 4; ++r) {
    const auto row = frame.camera_to_world.row(r);
    matrix.push_back(Json::array({row[0], row[1], row[2], row[3]}));
  }
  return {{"file_path", frame.file_path},
          {"camera_angle_x", frame.camera_angle_x},
          {"transform_matrix", std::move(matrix)}};
}

}  // namespace

ViewCamera hammersley_view(std::size_t i, std::size_t n, double offset0, double offset1, bool upper) {
  double u = (static_cast<double>(i) + offset0) / static_cast<double>(n);
  const double v = radical_inverse(i) + offset1;
  if (upper) u = u < 0.25 ? 2.0 * u : 2.0 * u / 3.0 + 1.0 / 3.0;
  ViewCamera view;
  view.pitch = std::acos(std::clamp(1.0 - 2.0 * u, -1.0, 1.0)) - 0.5 * kPi;
  view.yaw = 2.0 * kPi * v;
  return view;
}

std::vector<ViewCamera> feature_views(std::size_t n, double offset0, double offset1) {
  require_views(n);
  std::vector<ViewCamera> views;
  for (std::size_t i = 0; i < n; ++i) {
    views.push_back(hammersley_view(i, n, offset0, offset1, true));
    views.back().radius = kFeatureRadius;
    views.back().fov = kFeatureFov;
  }
  return views;
}

std::vector<ViewCamera> condition_views(std::size_t n, Rng& rng) {
  const double offset0 = rng.uniform(), offset1 = rng.uniform();
  std::vector<ViewCamera> views = feature_views(n, offset0, offset1);
  const double nearest = kCubeSphere / std::sin(0.5 * kWidestFov),
               farthest = kCubeSphere / std::sin(0.5 * kNarrowestFov);
  for (ViewCamera& view : views) {
    view.radius = 1.0 / std::sqrt(rng.uniform(1.0 / (farthest * farthest), 1.0 / (nearest * nearest)));
    view.fov = 2.0 * std::asin(kCubeSphere / view.radius);
  }
  return views;
}

std::vector<ViewCamera> front_views(std::size_t n, Rng& rng) {
  require_views(n);
  constexpr double kFront = -0.5 * kPi, kSide = kPi / 3.0, kLowest = -5.0 * kPi / 180.0, kHighest = kPi / 6.0;
  std::vector<ViewCamera> views(n);
  for (std::size_t i = 0; i < n; ++i) {
    const double place = (static_cast<double>(i) + rng.uniform()) / static_cast<double>(n);
    views[i].yaw = kFront + kSide * (2.0 * place - 1.0);
    views[i].pitch = rng.uniform(kLowest, kHighest);
    views[i].fov = kFeatureFov;
    views[i].radius = kCubeSphere / std::sin(0.5 * kFeatureFov);
  }
  return views;
}

Eigen::Matrix4d camera_to_world(const ViewCamera& view) {
  const bool finite = std::isfinite(view.yaw) && std::isfinite(view.pitch) && std::isfinite(view.radius);
  if (!finite || !(view.radius > 0.0)) throw InputError("", "view", "its angles or its radius are out of range");
  if (!(view.fov > 0.0 && view.fov < kPi)) throw InputError("", "view", "its field of view is not between 0 and pi");
  const double cos_yaw = std::cos(view.yaw), sin_yaw = std::sin(view.yaw);
  const double cos_pitch = std::cos(view.pitch), sin_pitch = std::sin(view.pitch);
  const Eigen::Vector3d back(cos_yaw * cos_pitch, sin_yaw * cos_pitch, sin_pitch);
  Eigen::Matrix4d matrix = Eigen::Matrix4d::Identity();
  matrix.col(0).head<3>() = Eigen::Vector3d(-sin_yaw, cos_yaw, 0.0);
  matrix.col(1).head<3>() = Eigen::Vector3d(-cos_yaw * sin_pitch, -sin_yaw * sin_pitch, cos_pitch);
  matrix.col(2).head<3>() = back;
  matrix.col(3).head<3>() = view.radius * back;
  return matrix;
}

Eigen::Matrix4d extrinsics(const Frame& frame) { return extrinsics_of(frame.camera_to_world); }
Eigen::Matrix3d intrinsics(const Frame& frame) { return intrinsics_of(frame.camera_angle_x); }

Frame make_frame(const ViewCamera& view, std::string file_path) {
  return {std::move(file_path), view.fov, camera_to_world(view)};
}

PartCamera part_camera(const Frame& frame, const io::PixelBox& box, int size) {
  const Eigen::Vector3d back = frame.camera_to_world.block<3, 1>(0, 2);
  const double distance = frame.camera_to_world.block<3, 1>(0, 3).norm();
  const double width = box.x1 - box.x0, height = box.y1 - box.y0;
  PartCamera camera;
  camera.yaw = std::atan2(back.y(), back.x());
  camera.pitch = std::asin(std::clamp(back.z(), -1.0, 1.0));
  camera.nearness = 1.0 / distance;
  camera.scale = intrinsics(frame)(0, 0) * size / (0.5 * (width + height) * distance);
  camera.shift_x = (0.5 * size - box.x0) / width;
  camera.shift_y = (0.5 * size - box.y0) / height;
  return camera;
}

Transforms make_transforms(const std::vector<ViewCamera>& views, const Similarity& normalisation) {
  Transforms transforms;
  transforms.scale = normalisation.scale;
  transforms.offset = normalisation.offset;
  for (std::size_t i = 0; i < views.size(); ++i) {
    char name[32];
    std::snprintf(name, sizeof(name), "%03zu.png", i);
    transforms.frames.push_back(make_frame(views[i], name));
  }
  return transforms;
}

std::string format_transforms(const Transforms& transforms) {
  check_transforms(transforms, {"transforms.json", ""});
  const auto line = [](const Json& value) { return value.dump(-1, ' ', true); };
  std::string text = "{\n";
  text += "\"aabb\": " + line(Json::array({json_vector(transforms.aabb.low), json_vector(transforms.aabb.high)}));
  text += ",\n\"scale\": " + line(transforms.scale) + ",\n\"offset\": " + line(json_vector(transforms.offset));
  text += ",\n\"frames\": [\n";
  for (std::size_t i = 0; i < transforms.frames.size(); ++i) {
    try {
      text += line(json_frame(transforms.frames[i])) + (i + 1 < transforms.frames.size() ? ",\n" : "\n");
    } catch (const Json::exception&) {
      throw InputError("transforms.json", "/frames/" + std::to_string(i) + "/file_path", "the name is not UTF-8");
    }
  }
  return text + "]\n}\n";
}

void write_transforms(const std::filesystem::path& path, const Transforms& transforms) {
  write_file_atomically(path, format_transforms(transforms));
}

Transforms parse_transforms(std::string_view text, const std::string& file) {
  const Json json = parse_json(text, file, {16, 40 * kMostFrames});
  const Place top{file, ""};
  const Json& frames = member(json, "frames", top);
  if (!frames.is_array()) top.at("frames").refuse(std::string("expected a list, found ") + frames.type_name());
  if (frames.size() > kMostFrames) top.at("frames").refuse("more than 100000 frames");
  Transforms transforms;
  if (json.contains("aabb")) {
    const Json& aabb = list(json.at("aabb"), 2, top.at("aabb"));
    transforms.aabb.low = vector3(aabb[0], top.at("aabb").at(std::size_t{0}));
    transforms.aabb.high = vector3(aabb[1], top.at("aabb").at(std::size_t{1}));
  }
  if (json.contains("scale")) transforms.scale = number(json.at("scale"), top.at("scale"));
  if (json.contains("offset")) transforms.offset = vector3(json.at("offset"), top.at("offset"));
  for (std::size_t i = 0; i < frames.size(); ++i) {
    const Place place = top.at("frames").at(i);
    const Json& path = member(frames[i], "file_path", place);
    if (!path.is_string()) place.at("file_path").refuse(std::string("expected a text, found ") + path.type_name());
    Frame frame;
    frame.file_path = path.get<std::string>();
    frame.camera_angle_x = number(member(frames[i], "camera_angle_x", place), place.at("camera_angle_x"));
    frame.camera_to_world = matrix4(member(frames[i], "transform_matrix", place), place.at("transform_matrix"));
    transforms.frames.push_back(std::move(frame));
  }
  check_transforms(transforms, top);
  return transforms;
}

Transforms read_transforms(const std::filesystem::path& path) {
  return parse_transforms(read_file(path, kLargestFile), path.string());
}

}  // namespace anigen::render
