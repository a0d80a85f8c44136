// Coverage-guided fuzzing by libFuzzer. The program's name chooses the target: fuzz_glb, fuzz_obj, …, links of one
// program (fuzz/CMakeLists.txt); scripts/fuzz.sh runs them.
#include <cstdint>
#include <cstdio>
#include <cstdlib>
#include <filesystem>
#include <string>

#include "fuzz/targets.h"

namespace {

anigen::fuzz::Target chosen = nullptr;

}  // namespace

extern "C" int LLVMFuzzerInitialize(int* /*argc*/, char*** argv) {
  std::string name = std::filesystem::path((*argv)[0]).filename().string();
  if (name.rfind("fuzz_", 0) == 0) name = name.substr(5);
  const auto known = anigen::fuzz::targets();
  const auto found = known.find(name);
  if (found == known.end()) {
    std::fprintf(stderr, "fuzz: \"%s\" is none of:", name.c_str());
    for (const auto& [word, target] : known) std::fprintf(stderr, " %s", word.c_str());
    std::fprintf(stderr, "\n");
    std::exit(2);
  }
  chosen = found->second;
  return 0;
}

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  anigen::fuzz::run(chosen, std::string(reinterpret_cast<const char*>(data), size));
  return 0;
}
