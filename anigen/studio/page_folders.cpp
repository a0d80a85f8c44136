#include <algorithm>
#include <cstdlib>
#include <system_error>
#include <vector>

#include "anigen/studio/server.h"

namespace anigen::studio {

namespace {

namespace fs = std::filesystem;

bool has(const fs::path& file) {
  std::error_code ignored;
  return fs::exists(file, ignored);
}

/// The folder and all above it.
std::vector<fs::path> upwards(fs::path folder) {
  std::vector<fs::path> folders;
  for (;; folder = folder.parent_path()) {
    folders.push_back(folder);
    if (folder == folder.parent_path()) return folders;
  }
}

/// An npm package that has these files: beside the page, else as Node would find it.
fs::path find_package(const fs::path& page, const std::string& name, const std::vector<std::string>& files) {
  if (page.empty()) return {};
  std::vector<fs::path> places{page / name};
  for (const fs::path& folder : upwards(page)) {
    places.push_back(folder / "node_modules" / name);
    places.push_back(folder / ".cache/node/node_modules" / name);
  }
  if (const char* listed = std::getenv("NODE_PATH")) {
    const std::string paths = listed;
    for (std::size_t begin = 0; begin <= paths.size();) {
      const std::size_t end = std::min(paths.find(':', begin), paths.size());
      if (end > begin) places.push_back(fs::path(paths.substr(begin, end - begin)) / name);
      begin = end + 1;
    }
  }
  const auto whole = [&](const fs::path& place) {
    return std::all_of(files.begin(), files.end(), [&](const std::string& file) { return has(place / file); });
  };
  const auto found = std::find_if(places.begin(), places.end(), whole);
  return found == places.end() ? fs::path() : *found;
}

}  // namespace

fs::path find_page(const fs::path& program) {
  std::error_code ignored;
  const fs::path bin = fs::weakly_canonical(program, ignored).parent_path();
  const fs::path installed = bin.parent_path() / "share/anigen/studio";
  if (has(installed / "index.html")) return installed;
  for (const fs::path& folder : upwards(bin))
    if (has(folder / "anigen/studio/page/index.html")) return folder / "anigen/studio/page";
  return {};
}

fs::path find_three(const fs::path& page) {
  return find_package(page, "three", {"build/three.module.js", "examples/jsm/loaders/GLTFLoader.js"});
}

fs::path find_validator(const fs::path& page) {
  return find_package(page, "gltf-validator", {"gltf_validator.dart.js"});
}

fs::path find_openapi(const fs::path& page) {
  if (page.empty()) return {};
  for (const fs::path& folder : {page, page.parent_path()})
    if (has(folder / "openapi.json")) return folder / "openapi.json";
  return {};
}

fs::path find_gallery(const fs::path& page) {
  if (page.empty()) return {};
  if (has(page / "gallery")) return page / "gallery";
  const fs::path examples = page.parent_path().parent_path().parent_path() / "examples/creatures";
  return has(examples) ? examples : fs::path();
}

}  // namespace anigen::studio
