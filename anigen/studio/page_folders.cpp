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
  if (page.empty()) return {};
  std::vector<fs::path> places{page / "three"};
  for (const fs::path& folder : upwards(page)) {
    places.push_back(folder / "node_modules/three");
    places.push_back(folder / ".cache/node/node_modules/three");
  }
  if (const char* listed = std::getenv("NODE_PATH")) {
    const std::string paths = listed;
    for (std::size_t begin = 0; begin <= paths.size();) {
      const std::size_t end = std::min(paths.find(':', begin), paths.size());
      if (end > begin) places.push_back(fs::path(paths.substr(begin, end - begin)) / "three");
      begin = end + 1;
    }
  }
  for (const fs::path& place : places)
    if (has(place / "build/three.module.js") && has(place / "examples/jsm/loaders/GLTFLoader.js")) return place;
  return {};
}

fs::path find_gallery(const fs::path& page) {
  if (page.empty()) return {};
  if (has(page / "gallery")) return page / "gallery";
  const fs::path examples = page.parent_path().parent_path().parent_path() / "examples/creatures";
  return has(examples) ? examples : fs::path();
}

}  // namespace anigen::studio
