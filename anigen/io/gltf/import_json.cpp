#include "anigen/io/gltf/import_json.h"

#include <cmath>

#include "anigen/core/error.h"

namespace anigen::io::gltf_import {
JsonPlace::JsonPlace(const Json& value, const std::string& file, std::string pointer)
    : value_(&value), file_(&file), pointer_(std::move(pointer)) {}

void JsonPlace::fail(const std::string& problem) const {
  throw InputError(*file_, pointer_.empty() ? "/" : pointer_, problem);
}

void JsonPlace::not_supported(const std::string& feature) const {
  throw NotSupportedError(*file_, pointer_.empty() ? "/" : pointer_, feature);
}

std::optional<JsonPlace> JsonPlace::find(const char* key) const {
  if (!value_->is_object()) fail(std::string("expected an object, found ") + value_->type_name());
  const auto found = value_->find(key);
  if (found == value_->end()) return std::nullopt;
  return JsonPlace(*found, *file_, pointer_ + "/" + escaped_for_pointer(key));
}

JsonPlace JsonPlace::at(const char* key) const {
  std::optional<JsonPlace> member = find(key);
  if (!member) fail(std::string("'") + key + "' is missing");
  return *member;
}

std::vector<std::string> JsonPlace::keys() const {
  if (!value_->is_object()) fail(std::string("expected an object, found ") + value_->type_name());
  std::vector<std::string> result;
  for (const auto& item : value_->items()) result.push_back(item.key());
  return result;
}

std::size_t JsonPlace::size() const {
  if (!value_->is_array()) fail(std::string("expected an array, found ") + value_->type_name());
  return value_->size();
}

JsonPlace JsonPlace::operator[](std::size_t index) const {
  return JsonPlace((*value_)[index], *file_, pointer_ + "/" + std::to_string(index));
}

std::uint64_t JsonPlace::integer(std::uint64_t low, std::uint64_t high) const {
  std::uint64_t result = 0;
  if (value_->is_number_unsigned()) {
    result = value_->get<std::uint64_t>();
  } else if (value_->is_number_float()) {
    const double number = value_->get<double>();
    if (!(number >= 0.0 && number <= 9007199254740992.0) || number != std::floor(number))
      fail("expected a whole number ≥ 0");
    result = static_cast<std::uint64_t>(number);
  } else if (value_->is_number_integer()) {
    fail("expected a number ≥ 0, found " + std::to_string(value_->get<std::int64_t>()));
  } else {
    fail(std::string("expected a whole number, found ") + value_->type_name());
  }
  if (result < low || result > high) {
    fail(std::to_string(result) + " is outside [" + std::to_string(low) + ", " + std::to_string(high) + "]");
  }
  return result;
}

double JsonPlace::number() const {
  if (!value_->is_number()) fail(std::string("expected a number, found ") + value_->type_name());
  const double result = value_->get<double>();
  if (!std::isfinite(result)) fail("the number is not finite");
  return result;
}

std::string JsonPlace::string() const {
  if (!value_->is_string()) fail(std::string("expected a string, found ") + value_->type_name());
  return value_->get<std::string>();
}

bool JsonPlace::boolean() const {
  if (!value_->is_boolean()) fail(std::string("expected true or false, found ") + value_->type_name());
  return value_->get<bool>();
}

std::vector<double> JsonPlace::numbers(std::size_t count) const {
  if (size() != count) fail("expected " + std::to_string(count) + " numbers, found " + std::to_string(size()));
  std::vector<double> result(count);
  for (std::size_t i = 0; i < count; ++i) result[i] = (*this)[i].number();
  return result;
}

std::uint64_t JsonPlace::integer_or(const char* key, std::uint64_t fallback, std::uint64_t high) const {
  const std::optional<JsonPlace> member = find(key);
  return member ? member->integer(0, high) : fallback;
}

std::string JsonPlace::string_or(const char* key, const std::string& fallback) const {
  const std::optional<JsonPlace> member = find(key);
  return member ? member->string() : fallback;
}

bool JsonPlace::boolean_or(const char* key, bool fallback) const {
  const std::optional<JsonPlace> member = find(key);
  return member ? member->boolean() : fallback;
}

int JsonPlace::index_or_none(const char* key, std::size_t count, const char* what) const {
  const std::optional<JsonPlace> member = find(key);
  return member ? member->as_index(count, what) : -1;
}

int JsonPlace::index(const char* key, std::size_t count, const char* what) const {
  return at(key).as_index(count, what);
}

int JsonPlace::as_index(std::size_t count, const char* what) const {
  const std::uint64_t result = integer(0, 0x7FFFFFFF);
  if (result >= count) {
    fail(std::string("there is no ") + what + " " + std::to_string(result) + ": the file has " + std::to_string(count));
  }
  return static_cast<int>(result);
}

std::size_t JsonPlace::size_of(const char* key) const {
  const std::optional<JsonPlace> member = find(key);
  return member ? member->size() : 0;
}

}  // namespace anigen::io::gltf_import
