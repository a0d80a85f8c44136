// Images become rigged GLB files, with models that are loaded once.
//   image_to_rig IMAGE...
#include <anigen/anigen.h>
#include <cstdio>
#include <exception>
#include <filesystem>

int main(int argc, char** argv) try {
  using namespace anigen;
  if (argc < 2) {
    std::fprintf(stderr, "usage: %s IMAGE...\n", argv[0]);
    return 2;
  }
  engine::Generator generator;
  for (int i = 1; i < argc; ++i) {
    const engine::Generated made = generator.generate(argv[i]);
    const std::filesystem::path file = std::filesystem::path(argv[i]).stem().string() + ".glb";
    engine::save(made.asset, file);
    std::printf("%s: %zu joints, %zu vertices\n", file.c_str(), made.asset.skeleton.size(),
                made.asset.mesh.vertices.size());
  }
} catch (const std::exception& error) {
  std::fprintf(stderr, "error: %s\n", error.what());
  return 1;
}
