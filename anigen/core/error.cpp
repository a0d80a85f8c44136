#include "anigen/core/error.h"

#include <utility>

namespace anigen {
namespace {

std::string one_line(const std::string& file, const std::string& place, const std::string& problem) {
  std::string line = file;
  if (!place.empty()) line += (line.empty() ? "" : ": ") + place;
  return line.empty() ? problem : line + ": " + problem;
}

}  // namespace

InputError::InputError(std::string file, std::string place, std::string problem)
    : Error(one_line(file, place, problem)),
      file_(std::move(file)),
      place_(std::move(place)),
      problem_(std::move(problem)) {}

NotSupportedError::NotSupportedError(std::string file, std::string place, const std::string& feature)
    : InputError(std::move(file), std::move(place), "not supported: " + feature) {}

}  // namespace anigen
