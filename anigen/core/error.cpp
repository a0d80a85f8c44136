#include "anigen/core/error.h"

#include <algorithm>
#include <cctype>
#include <cstdio>
#include <new>
#include <utility>

#include "anigen/core/log.h"

namespace anigen {

namespace {

std::string one_line(const std::string& file, const std::string& place, const std::string& problem) {
  std::string line = file;
  if (!place.empty()) line += (line.empty() ? "" : ": ") + place;
  return line.empty() ? problem : line + ": " + problem;
}

/// c10::Error appends a backtrace of many lines; cv::Exception ends with a line break.
std::string without_backtrace(std::string text) {
  text.resize(std::min(text.find("\nException raised from "), text.size()));
  while (!text.empty() && std::isspace(static_cast<unsigned char>(text.back())) != 0) text.pop_back();
  std::replace_if(
      text.begin(), text.end(), [](char c) { return c == '\n' || c == '\r'; }, ' ');
  return text;
}

}  // namespace

InputError::InputError(std::string file, std::string place, std::string problem)
    : Error(one_line(file, place, problem)),
      file_(std::move(file)),
      place_(std::move(place)),
      problem_(std::move(problem)) {}

NotSupportedError::NotSupportedError(std::string file, std::string place, const std::string& feature)
    : InputError(std::move(file), std::move(place), "not supported: " + feature) {}

void require_between(double value, double lowest, double highest, const std::string& option) {
  if (value >= lowest && value <= highest) return;
  char range[80];
  std::snprintf(range, sizeof range, "must be between %.10g and %.10g", lowest, highest);
  throw InputError("", option, range);
}

std::string failure_of_item() {
  try {
    throw;
  } catch (const Interrupted&) {
    throw;
  } catch (const WriteError&) {
    throw;
  } catch (const InputError& error) {
    return error.what();
  } catch (const std::bad_alloc&) {
    release_freed_memory();
    return "out of memory";
  } catch (const std::exception& error) {
    std::string text = without_backtrace(error.what());
    return text.empty() ? "failed without a message" : text;
  }
}

}  // namespace anigen
