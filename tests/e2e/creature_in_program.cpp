// Exports a procedural creature and hands it to another program:
//   creature_in_program COMMAND...
// where {glb} and {fbx} stand for the creature's file and {png} for a picture that the program may write. The exit code
// is the program's; 77, skipped, when there is no such program.
#include <cstdio>
#include <exception>
#include <string>

#include "anigen/asset/rigged_asset.h"
#include "anigen/creatures/body.h"
#include "anigen/io/write_rigged.h"
#include "tests/e2e/other_program.h"
#include "tests/support/paths.h"

int main(int argc, char** argv) try {
  const anigen::test::TemporaryFolder folder;
  anigen::Asset asset = anigen::creatures::make_creature("biped", 0, 3);
  anigen::normalize(asset);
  const std::string glb = (folder / "creature.glb").string(), fbx = (folder / "creature.fbx").string();
  for (const std::string& file : {glb, fbx}) anigen::io::write_rigged(file, asset);
  std::string command;
  for (int i = 1; i < argc; ++i) {
    const std::string word = argv[i];
    command += anigen::test::quoted(word == "{glb}"   ? glb
                                    : word == "{fbx}" ? fbx
                                    : word == "{png}" ? (folder / "creature.png").string()
                                                      : word) +
               " ";
  }
  return anigen::test::run_program(command);
} catch (const std::exception& error) {
  std::fprintf(stderr, "%s\n", error.what());
  return 1;
}
