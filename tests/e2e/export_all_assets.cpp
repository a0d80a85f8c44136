// Exports every real asset, with four influences per vertex and with all of them, in both axis conventions and both
// containers, then runs Khronos' validator on the files. Exit code 77: skipped, something is not installed.
#include <sys/wait.h>

#include <algorithm>
#include <cstdio>
#include <cstdlib>
#include <exception>
#include <string>
#include <vector>

#include "anigen/core/error.h"
#include "anigen/io/gltf/gltf.h"
#include "tests/support/paths.h"

namespace {

namespace fs = std::filesystem;
using anigen::io::ExportAxes;
using anigen::io::ExportOptions;

constexpr int kSkipped = 77;

std::vector<fs::path> real_assets() {
  std::vector<fs::path> files;
  const fs::path folder = anigen::test::assets_dir() / "rigged";
  if (!fs::exists(folder)) return files;
  for (const auto& entry : fs::recursive_directory_iterator(folder)) {
    if (entry.path().extension() == ".glb" || entry.path().extension() == ".gltf") files.push_back(entry.path());
  }
  std::sort(files.begin(), files.end());
  return files;
}

// @return the files written
std::vector<std::string> export_asset(const fs::path& source, const fs::path& folder) {
  const anigen::Asset asset = anigen::io::read_gltf(source).asset;
  const std::string stem = (folder / source.stem()).string();
  ExportOptions all;
  all.influences = std::max<std::size_t>(1, asset.skin.largest_row());
  ExportOptions published = all;
  published.axes = ExportAxes::kPublished;
  std::vector<std::string> written = {stem + ".glb", stem + "_all.glb", stem + "_published.gltf"};
  anigen::io::write_gltf(written[0], asset);
  anigen::io::write_gltf(written[1], asset, all);
  anigen::io::write_gltf(written[2], asset, published);
  return written;
}

std::string quoted(const std::string& text) {
  std::string result = "'";
  for (const char c : text) result += c == '\'' ? std::string("'\\''") : std::string(1, c);
  return result + "'";
}

int exit_code_of(const std::string& command) {
  const int status = std::system(command.c_str());
  return WIFEXITED(status) ? WEXITSTATUS(status) : 1;
}

}  // namespace

int main(int argc, char** argv) {
  if (argc != 2) {
    std::fprintf(stderr, "usage: %s VALIDATE_GLTF_MJS\n", argv[0]);
    return 2;
  }
  const std::vector<fs::path> sources = real_assets();
  if (sources.empty()) {
    std::printf("skipped: no rigged assets in %s\n", anigen::test::assets_dir().c_str());
    return anigen::test::fixtures_are_required() ? 1 : kSkipped;
  }
  if (exit_code_of("node --version") != 0) {
    std::printf("skipped: node is not installed\n");
    return kSkipped;
  }
  const anigen::test::TemporaryFolder folder;
  std::string command = std::string("node ") + quoted(argv[1]);
  std::size_t exported = 0;
  for (const fs::path& source : sources) {
    try {
      for (const std::string& file : export_asset(source, folder.path())) command += ' ' + quoted(file);
      ++exported;
    } catch (const anigen::NotSupportedError& error) {
      std::printf("left out: %s\n", error.what());
    } catch (const std::exception& error) {
      std::printf("failed: %s\n", error.what());
      return 1;
    }
  }
  std::printf("%zu of %zu assets exported\n", exported, sources.size());
  std::fflush(stdout);
  return exit_code_of(command);
}
