// Writes a page with the 3D view of two procedural creatures, as reports of experiments have it, and hands it to
// another program:
//   report_in_browser SOURCES COMMAND...
// The command gets the page and a folder for pictures as its last arguments. The exit code is the program's; 77,
// skipped, without three.js or without such a program.
#include <cstdio>
#include <exception>
#include <string>

#include "anigen/asset/rigged_asset.h"
#include "anigen/core/files.h"
#include "anigen/creatures/body.h"
#include "anigen/eval/comparison_report.h"
#include "anigen/experiment/sheets.h"
#include "anigen/io/gltf/gltf.h"
#include "tests/e2e/other_program.h"
#include "tests/support/paths.h"

int main(int argc, char** argv) try {
  namespace experiment = anigen::experiment;
  const anigen::test::TemporaryFolder folder;
  const std::filesystem::path three = experiment::find_three(argc > 1 ? argv[1] : ".");
  if (three.empty()) {
    std::fprintf(stderr, "three.js is not installed\n");
    return anigen::test::kSkipped;
  }
  experiment::ViewedAsset shown{"creatures", {}};
  for (const char* family : {"biped", "quadruped"}) {
    anigen::Asset asset = anigen::creatures::make_creature(family, 0, 3);
    anigen::normalize(asset);
    shown.shown.push_back({family, folder / (std::string(family) + ".glb")});
    anigen::io::write_gltf(shown.shown.back().file, asset);
  }
  const std::filesystem::path page = folder / "report.html";
  anigen::write_file_atomically(page, anigen::eval::page_begin("Creatures") +
                                          experiment::viewer_html({shown}, "Creatures in 3D", 1) +
                                          experiment::viewer_script_html(three) + anigen::eval::page_end());
  using anigen::test::quoted;
  std::string command;
  for (int i = 2; i < argc; ++i) command += quoted(argv[i]) + " ";
  return anigen::test::run_program(command + quoted(page.string()) + " " + quoted((folder / "pictures").string()));
} catch (const std::exception& error) {
  std::fprintf(stderr, "%s\n", error.what());
  return 1;
}
