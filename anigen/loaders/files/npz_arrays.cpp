#include "anigen/loaders/files/npz_arrays.h"

#include <cmath>

#include "anigen/core/error.h"
#include "anigen/io/npz.h"

namespace anigen::loaders {
namespace {

std::string text_of(const std::vector<std::int64_t>& shape) {
  std::string text;
  for (const std::int64_t size : shape) text += (text.empty() ? "" : ", ") + (size < 0 ? "*" : std::to_string(size));
  return "[" + text + "]";
}

void check(const io::NdArray& array, const ArraySpec& spec, const std::string& file) {
  bool fits = array.shape.size() == spec.shape.size();
  for (std::size_t i = 0; fits && i < spec.shape.size(); ++i) {
    fits = spec.shape[i] < 0 || spec.shape[i] == array.shape[i];
  }
  if (!fits) {
    throw InputError(file, spec.name, "has shape " + text_of(array.shape) + ", expected " + text_of(spec.shape));
  }
  std::size_t count = 0;
  if (!io::count_elements(array.shape, io::size_of(array.dtype), count) || count > spec.most) {
    throw InputError(
        file, spec.name,
        "has shape " + text_of(array.shape) + "; more than " + std::to_string(spec.most) + " numbers are not read");
  }
}

}  // namespace

io::NamedArrays read_arrays(const std::filesystem::path& path, const std::vector<ArraySpec>& specs) {
  const std::string file = path.string();
  // Pickled arrays have no header of numbers; they are checked once they are read.
  const io::NamedArrays headers = io::read_npz_headers(path);
  std::vector<std::string> names;
  for (const ArraySpec& spec : specs) {
    names.push_back(spec.name);
    if (const io::NdArray* header = io::find(headers, spec.name)) check(*header, spec, file);
  }
  io::NamedArrays arrays = io::read_npz(path, names);
  for (const ArraySpec& spec : specs) {
    const io::NdArray* array = io::find(arrays, spec.name);
    if (array == nullptr) throw InputError(file, spec.name, "no such array");
    check(*array, spec, file);
  }
  return arrays;
}

const io::NdArray& named(const io::NamedArrays& arrays, const std::string& name) {
  const io::NdArray* found = io::find(arrays, name);
  if (found == nullptr) throw Error("array '" + name + "' was not asked for");
  return *found;
}

std::string place_of(const std::string& name, const std::vector<std::int64_t>& shape, std::size_t flat) {
  std::string index;
  for (std::size_t axis = shape.size(); axis-- > 0;) {
    const auto size = static_cast<std::size_t>(shape[axis]);
    index = std::to_string(flat % size) + (index.empty() ? "" : ", " + index);
    flat /= size;
  }
  return name + "[" + index + "]";
}

std::vector<float> finite_numbers(const io::NamedArrays& arrays, const std::string& name, const std::string& file) {
  const io::NdArray& array = named(arrays, name);
  std::vector<float> values = array.as<float>();
  for (std::size_t i = 0; i < values.size(); ++i) {
    if (!std::isfinite(values[i])) throw InputError(file, place_of(name, array.shape, i), "is not finite");
  }
  return values;
}

std::vector<std::int64_t> whole_numbers(const io::NamedArrays& arrays, const std::string& name,
                                        const std::string& file) {
  try {
    return named(arrays, name).as<std::int64_t>();
  } catch (const Error& error) {
    throw InputError(file, name, error.what());
  }
}

}  // namespace anigen::loaders
