#include "anigen/experiment/report_pictures.h"

#include <algorithm>
#include <system_error>

#include "anigen/core/atomic_file.h"
#include "anigen/core/base64.h"
#include "anigen/core/html.h"

namespace anigen::experiment {
namespace {

namespace fs = std::filesystem;

constexpr std::uintmax_t kLargestPicture = 32u << 20;

bool matches(const std::string& name, const std::string& pattern) {
  const std::size_t star = pattern.find('*');
  if (star == std::string::npos) return name == pattern;
  const std::string before = pattern.substr(0, star), after = pattern.substr(star + 1);
  return name.size() >= before.size() + after.size() && name.compare(0, before.size(), before) == 0 &&
         name.compare(name.size() - after.size(), after.size(), after) == 0;
}

}  // namespace

std::vector<fs::path> matching_files(const fs::path& folder, const std::string& pattern) {
  std::vector<fs::path> found{folder};
  for (const fs::path& part : fs::path(pattern)) {
    std::vector<fs::path> next;
    for (const fs::path& parent : found) {
      std::error_code error;
      if (!fs::is_directory(parent, error)) continue;
      for (const auto& entry : fs::directory_iterator(parent)) {
        if (matches(entry.path().filename(), part)) next.push_back(entry.path());
      }
    }
    found = std::move(next);
  }
  std::sort(found.begin(), found.end());
  return found;
}

std::string file_of_asset(std::string pattern, const std::string& asset) {
  return pattern.replace(pattern.find('*'), 1, asset);
}

std::string embedded_picture(const fs::path& file) {
  const std::string extension = file.extension();
  const std::string type = extension == ".png" ? "png" : extension == ".jpg" || extension == ".jpeg" ? "jpeg" : "";
  if (type.empty()) return "";
  return "<img loading=\"lazy\" style=\"max-width:100%\" alt=\"" + html_escaped(file.filename().string()) +
         "\" src=\"data:image/" + type + ";base64," + base64(std::string_view(read_file(file, kLargestPicture))) +
         "\">";
}

}  // namespace anigen::experiment
