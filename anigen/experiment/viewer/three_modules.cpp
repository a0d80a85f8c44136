#include "anigen/experiment/viewer/three_modules.h"

#include <algorithm>
#include <cstdlib>
#include <iterator>
#include <system_error>
#include <utility>

#include "anigen/core/atomic_file.h"
#include "anigen/core/base64.h"
#include "anigen/core/error.h"
#include "anigen/core/json.h"

namespace anigen::experiment {
namespace {

namespace fs = std::filesystem;

constexpr std::uintmax_t kLargestModule = 8u << 20;

/// A module of the package, and what other modules call it.
struct Module {
  const char* name;      ///< in the import map
  const char* file;      ///< in the package
  const char* relative;  ///< how its siblings import it; nullptr: by its name
};

constexpr Module kAddons[] = {
    {"three/addons/GLTFLoader.js", "examples/jsm/loaders/GLTFLoader.js", nullptr},
    {"three/addons/OrbitControls.js", "examples/jsm/controls/OrbitControls.js", nullptr},
    {"three/addons/BufferGeometryUtils.js", "examples/jsm/utils/BufferGeometryUtils.js",
     "../utils/BufferGeometryUtils.js"},
};
/// Newer releases come without the small files.
constexpr Module kSmall[] = {{"three", "build/three.module.min.js", nullptr},
                             {"three/core", "build/three.core.min.js", "./three.core.min.js"}};
constexpr Module kPlain[] = {{"three", "build/three.module.js", nullptr},
                             {"three/core", "build/three.core.js", "./three.core.js"}};
/// GLTFLoader of newer releases imports it.
constexpr Module kSkeletons = {"three/addons/SkeletonUtils.js", "examples/jsm/utils/SkeletonUtils.js",
                               "../utils/SkeletonUtils.js"};

bool is_file(const fs::path& file) {
  std::error_code error;
  return fs::is_regular_file(file, error);
}

void replace_all(std::string& text, const std::string& from, const std::string& to) {
  for (std::size_t at = text.find(from); at != std::string::npos; at = text.find(from, at + to.size()))
    text.replace(at, from.size(), to);
}

/// Renames `from "./three.core.js"` and its like.
std::string with_names(std::string source, const std::vector<Module>& modules) {
  for (const Module& module : modules) {
    if (module.relative == nullptr) continue;
    for (const char quote : {'"', '\''})
      replace_all(source, quote + std::string(module.relative) + quote, quote + std::string(module.name) + quote);
  }
  return source;
}

}  // namespace

fs::path find_three(const fs::path& start) {
  std::vector<fs::path> folders;
  for (fs::path folder = fs::absolute(start).lexically_normal();; folder = folder.parent_path()) {
    folders.push_back(folder / "node_modules");
    folders.push_back(folder / ".cache" / "node" / "node_modules");
    if (folder == folder.parent_path()) break;
  }
  if (const char* listed = std::getenv("NODE_PATH")) {
    const std::string paths = listed;
    for (std::size_t begin = 0; begin <= paths.size();) {
      const std::size_t end = std::min(paths.find(':', begin), paths.size());
      if (end > begin) folders.emplace_back(paths.substr(begin, end - begin));
      begin = end + 1;
    }
  }
  for (const fs::path& folder : folders) {
    if (is_file(folder / "three" / "package.json")) return folder / "three";
  }
  return {};
}

std::string three_import_map(const fs::path& three) {
  const bool small = is_file(three / kSmall[0].file) && is_file(three / kSmall[1].file);
  std::vector<Module> modules(std::begin(kAddons), std::end(kAddons));
  const auto& core = small ? kSmall : kPlain;
  modules.insert(modules.end(), std::begin(core), std::end(core));
  if (is_file(three / kSkeletons.file)) modules.push_back(kSkeletons);
  Json imports = Json::object();
  for (const Module& module : modules) {
    const std::string source = with_names(read_file(three / module.file, kLargestModule), modules);
    imports[module.name] = "data:text/javascript;base64," + base64(std::string_view(source));
  }
  return Json{{"imports", std::move(imports)}}.dump();
}

}  // namespace anigen::experiment
