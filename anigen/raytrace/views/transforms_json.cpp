#include "anigen/raytrace/views/transforms_json.h"

#include <Eigen/LU>
#include <cmath>
#include <cstdio>
#include <utility>

#include "anigen/core/atomic_file.h"
#include "anigen/core/error.h"
#include "anigen/core/json.h"
#include "anigen/core/numeric.h"
#include "anigen/raytrace/views/projection.h"

namespace anigen::raytrace {
namespace {

constexpr std::size_t kMostFrames = 100'000;
constexpr std::uintmax_t kLargestFile = std::uintmax_t{256} << 20;
constexpr double kLargestNumber = 1e6;  ///< far outside any object of size 1
constexpr double kRigid = 1e-3;         ///< single-precision writers round to 1e-6

/// Where a value is in the file, for messages.
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
  if (!matrix.allFinite() || matrix.cwiseAbs().maxCoeff() > kLargestNumber) {
    place.refuse("the matrix is not finite or beyond 1e6");
  }
  const Eigen::Matrix3d rotation = matrix.topLeftCorner<3, 3>();
  const double skew = (rotation.transpose() * rotation - Eigen::Matrix3d::Identity()).cwiseAbs().maxCoeff();
  const double last = (matrix.row(3) - Eigen::RowVector4d(0, 0, 0, 1)).cwiseAbs().maxCoeff();
  if (!(skew <= kRigid) || !(last <= kRigid) || rotation.determinant() < 0.0) {
    place.refuse("the matrix is not a rigid motion (a rotation and a position, last row 0 0 0 1)");
  }
}

Eigen::Matrix4d matrix4(const Json& value, const Place& place) {
  list(value, 4, place);
  Eigen::Matrix4d result;
  for (std::size_t r = 0; r < 4; ++r) {
    list(value[r], 4, place.at(r));
    for (std::size_t c = 0; c < 4; ++c) {
      result(static_cast<Eigen::Index>(r), static_cast<Eigen::Index>(c)) = number(value[r][c], place.at(r).at(c));
    }
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
    if (static_cast<unsigned char>(c) < 0x20 || c == '\\' || c == ':') {
      place.refuse("the file name has a character that is not allowed");
    }
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
  if (!box_finite || !(transforms.aabb.low.array() <= transforms.aabb.high.array()).all()) {
    top.at("aabb").refuse("must be finite, and the lower corner must not exceed the upper one");
  }
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

Eigen::Matrix4d extrinsics(const Frame& frame) { return extrinsics_of(frame.camera_to_world); }
Eigen::Matrix3d intrinsics(const Frame& frame) { return intrinsics_of(frame.camera_angle_x); }

Frame make_frame(const ViewCamera& view, std::string file_path) {
  return {std::move(file_path), view.fov, camera_to_world(view)};
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

}  // namespace anigen::raytrace
