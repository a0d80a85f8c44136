#include "anigen/experiment/report_pictures.h"

#include <algorithm>
#include <cmath>
#include <system_error>

#include "anigen/core/atomic_file.h"
#include "anigen/core/base64.h"
#include "anigen/core/error.h"
#include "anigen/core/html.h"
#include "anigen/io/image.h"
#include "anigen/io/image_resize.h"

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

io::Image panel_of(io::Image image, Panel panel) {
  if (panel.of == 1) return image;
  const int left = image.width * (panel.number - 1) / panel.of, right = image.width * panel.number / panel.of;
  io::Image part(std::max(1, right - left), image.height);
  for (int y = 0; y < part.height; ++y) {
    const std::uint8_t* row = image.pixel(std::min(left, image.width - 1), y);
    std::copy(row, row + io::kImageChannels * part.width, part.pixel(0, y));
  }
  return part;
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

std::string thumbnail(const fs::path& file, int height, Panel panel) {
  constexpr int kQuality = 80, kWidest = 1000;
  if (file.empty()) return "<span class=\"none\">no file</span>";
  try {
    const io::Image image = panel_of(io::read_image(file), panel);
    const double width = std::round(static_cast<double>(image.width) * height / image.height);
    const io::Image small = io::resize_lanczos(image, std::clamp(static_cast<int>(width), 1, kWidest), height,
                                               io::ResizeAlpha::kPremultiplied);
    const std::vector<std::uint8_t> bytes = io::encode_jpeg(small, kQuality);
    return "<img loading=\"lazy\" alt=\"" + html_escaped(file.filename().string()) +
           "\" src=\"data:image/jpeg;base64," +
           base64(std::string_view(reinterpret_cast<const char*>(bytes.data()), bytes.size())) + "\">";
  } catch (const Error& problem) {
    return "<span class=\"none\">" + html_escaped(problem.what()) + "</span>";
  }
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
