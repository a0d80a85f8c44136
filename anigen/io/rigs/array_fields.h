#pragma once
#include <Eigen/Core>
#include <cstdint>
#include <string>
#include <vector>

#include "anigen/asset/mesh.h"
#include "anigen/io/ndarray.h"

namespace anigen::io {

/// The named arrays of one sample, checked while they are taken: every refusal is an InputError that names the file
/// and the array.
class ArrayFields {
 public:
  /// @param file for messages; where a file has many samples, with the sample
  ArrayFields(const NamedArrays& arrays, std::string file) : arrays_(arrays), file_(std::move(file)) {}

  const std::string& file() const { return file_; }
  bool has(const std::string& name) const { return find(arrays_, name) != nullptr; }
  /// Of these names the first that is there, else an empty string.
  std::string first_of(const std::vector<std::string>& names) const;

  /// The array with this shape, -1 standing for any size.
  const NdArray& array(const std::string& name, const std::vector<std::int64_t>& shape) const;
  /// Its first size. @throws InputError for a scalar
  std::int64_t rows(const std::string& name) const;
  std::size_t dimensions(const std::string& name) const;

  /// The first three columns of [n, >= 3], finite.
  std::vector<Eigen::Vector3f> points(const std::string& name) const;
  std::vector<Eigen::Vector3d> precise_points(const std::string& name) const;
  /// Columns 3 to 5 of [n, >= 6], finite.
  std::vector<Eigen::Vector3d> second_points(const std::string& name) const;
  /// Three columns from this one on of [n, any], whatever they hold; empty when there are fewer columns.
  std::vector<Eigen::Vector3f> unchecked_points(const std::string& name, std::size_t first_column) const;
  /// Whole numbers of this shape.
  std::vector<std::int32_t> integers(const std::string& name, const std::vector<std::int64_t>& shape) const;
  std::int32_t integer(const std::string& name) const;
  /// Numbers of this shape; may be NaN.
  std::vector<float> reals(const std::string& name, const std::vector<std::int64_t>& shape) const;
  /// [F, 3] with every corner in [0, vertices).
  std::vector<Triangle> triangles(const std::string& name, std::size_t vertices) const;

  [[noreturn]] void fail(const std::string& place, const std::string& problem) const;

 private:
  template <typename Vector>
  std::vector<Vector> columns(const std::string& name, std::size_t first) const;
  template <typename Vector>
  std::vector<Vector> finite_columns(const std::string& name, std::size_t first) const;

  const NamedArrays& arrays_;
  std::string file_;
};

}  // namespace anigen::io
