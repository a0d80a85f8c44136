#include "anigen/io/rigs/array_fields.h"

#include <utility>

#include "anigen/core/error.h"

namespace anigen::io {
namespace {

std::string shape_text(const std::vector<std::int64_t>& shape) {
  std::string text = "[";
  for (std::size_t i = 0; i < shape.size(); ++i)
    text += (i == 0 ? "" : ", ") + (shape[i] < 0 ? std::string("any") : std::to_string(shape[i]));
  return text + "]";
}

}  // namespace

void ArrayFields::fail(const std::string& place, const std::string& problem) const {
  throw InputError(file_, place, problem);
}

std::string ArrayFields::first_of(const std::vector<std::string>& names) const {
  for (const std::string& name : names) {
    if (has(name)) return name;
  }
  return "";
}

const NdArray& ArrayFields::array(const std::string& name, const std::vector<std::int64_t>& shape) const {
  const NdArray* found = find(arrays_, name);
  if (found == nullptr) fail(name, "the array is missing");
  bool fits = found->shape.size() == shape.size();
  for (std::size_t i = 0; fits && i < shape.size(); ++i) fits = shape[i] < 0 || found->shape[i] == shape[i];
  if (!fits) fail(name, "its shape is " + shape_text(found->shape) + ", expected " + shape_text(shape));
  return *found;
}

std::int64_t ArrayFields::rows(const std::string& name) const {
  const NdArray* found = find(arrays_, name);
  if (found == nullptr) fail(name, "the array is missing");
  if (found->shape.empty()) fail(name, "is one number, expected an array");
  return found->shape[0];
}

std::size_t ArrayFields::dimensions(const std::string& name) const {
  const NdArray* found = find(arrays_, name);
  if (found == nullptr) fail(name, "the array is missing");
  return found->shape.size();
}

template <typename Vector>
std::vector<Vector> ArrayFields::columns(const std::string& name, std::size_t first) const {
  const NdArray& found = array(name, {-1, -1});
  if (found.shape[0] == 0) return {};  // some writers make [0, 0] of an empty list
  const auto width = static_cast<std::size_t>(found.shape[1]);
  if (width < first + 3) return {};
  const auto values = found.as<typename Vector::Scalar>();
  std::vector<Vector> points(values.size() / width);
  for (std::size_t i = 0; i < points.size(); ++i) {
    for (std::size_t k = 0; k < 3; ++k) points[i][static_cast<Eigen::Index>(k)] = values[i * width + first + k];
  }
  return points;
}

template <typename Vector>
std::vector<Vector> ArrayFields::finite_columns(const std::string& name, std::size_t first) const {
  const std::vector<Vector> points = columns<Vector>(name, first);
  if (points.empty() && rows(name) > 0) {
    const std::int64_t width = array(name, {-1, -1}).shape[1];
    fail(name, "has " + std::to_string(width) + " columns, expected at least " + std::to_string(first + 3));
  }
  for (std::size_t i = 0; i < points.size(); ++i) {
    if (!points[i].allFinite()) fail(name + "[" + std::to_string(i) + "]", "is not finite");
  }
  return points;
}

std::vector<Eigen::Vector3f> ArrayFields::points(const std::string& name) const {
  return finite_columns<Eigen::Vector3f>(name, 0);
}

std::vector<Eigen::Vector3d> ArrayFields::precise_points(const std::string& name) const {
  return finite_columns<Eigen::Vector3d>(name, 0);
}

std::vector<Eigen::Vector3d> ArrayFields::second_points(const std::string& name) const {
  return finite_columns<Eigen::Vector3d>(name, 3);
}

std::vector<Eigen::Vector3f> ArrayFields::unchecked_points(const std::string& name, std::size_t first_column) const {
  return columns<Eigen::Vector3f>(name, first_column);
}

std::vector<std::int32_t> ArrayFields::integers(const std::string& name, const std::vector<std::int64_t>& shape) const {
  const NdArray& found = array(name, shape);
  try {
    return found.as<std::int32_t>();
  } catch (const Error& error) {  // it does not know which file it is
    fail(name, error.what());
  }
}

std::int32_t ArrayFields::integer(const std::string& name) const {
  const NdArray* found = find(arrays_, name);
  if (found == nullptr) fail(name, "is missing");
  if (found->count() != 1) fail(name, "expected one number");
  return integers(name, found->shape)[0];
}

std::vector<float> ArrayFields::reals(const std::string& name, const std::vector<std::int64_t>& shape) const {
  return array(name, shape).as<float>();
}

std::vector<Triangle> ArrayFields::triangles(const std::string& name, std::size_t vertices) const {
  if (rows(name) == 0) return {};
  const std::vector<std::int32_t> corners = integers(name, {-1, 3});
  std::vector<Triangle> faces(corners.size() / 3);
  for (std::size_t i = 0; i < corners.size(); ++i) {
    if (corners[i] < 0 || static_cast<std::size_t>(corners[i]) >= vertices) {
      fail(name + "[" + std::to_string(i / 3) + "]",
           "names vertex " + std::to_string(corners[i]) + " of " + std::to_string(vertices));
    }
    faces[i / 3][i % 3] = corners[i];
  }
  return faces;
}

}  // namespace anigen::io
