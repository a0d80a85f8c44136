#pragma once
#include <cstddef>
#include <cstdint>
#include <filesystem>
#include <string>
#include <vector>

#include "anigen/io/ndarray.h"

namespace anigen::loaders {

/// What a member of a dataset's NPZ file has to look like.
struct ArraySpec {
  std::string name;
  std::vector<std::int64_t> shape;          ///< -1: any size
  std::size_t most = std::size_t{1} << 28;  ///< numbers at most, checked before they are read
};

/// Reads exactly these members, their headers first, so that a hostile size is refused before it is allocated.
/// @throws InputError naming file and array: missing members, another shape, too many numbers
io::NamedArrays read_arrays(const std::filesystem::path& path, const std::vector<ArraySpec>& specs);

/// The array of that name, of which there is one.
const io::NdArray& named(const io::NamedArrays& arrays, const std::string& name);

/// "name[i, j]": the place of one number, for messages.
std::string place_of(const std::string& name, const std::vector<std::int64_t>& shape, std::size_t flat);

/// All numbers, row-major. @throws InputError naming the first that is not finite
std::vector<float> finite_numbers(const io::NamedArrays& arrays, const std::string& name, const std::string& file);
/// @throws InputError when a number is no integer
std::vector<std::int64_t> whole_numbers(const io::NamedArrays& arrays, const std::string& name,
                                        const std::string& file);

}  // namespace anigen::loaders
