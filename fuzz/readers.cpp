// Coverage-guided fuzzing of all readers by libFuzzer. The program's name chooses the reader: fuzz_glb, fuzz_obj, …,
// links of one program (fuzz/CMakeLists.txt); scripts/fuzz.sh runs them. A reader may throw anigen::Error and nothing
// else; what it accepts must be sound.
#include <unistd.h>

#include <cstdint>
#include <cstdio>
#include <cstdlib>
#include <cstring>
#include <filesystem>
#include <fstream>
#include <map>
#include <string>
#include <vector>

#include "anigen/core/config.h"
#include "anigen/core/error.h"
#include "anigen/io/arrays/npz.h"
#include "anigen/io/arrays/pickle.h"
#include "anigen/io/arrays/safetensors.h"
#include "anigen/io/arrays/torch_archive.h"
#include "anigen/io/gltf/gltf.h"
#include "anigen/io/image.h"
#include "anigen/io/mtl.h"
#include "anigen/io/obj.h"
#include "anigen/io/ply.h"
#include "anigen/io/rigs/bvh.h"
#include "anigen/io/rigs/text_rig.h"
#include "anigen/io/stl.h"
#include "anigen/io/three_mf.h"

namespace {

namespace fs = std::filesystem;
using namespace anigen;

constexpr std::size_t kMostVertices = 1'000'000;

/// The input as a file in memory, for readers that take a path.
fs::path as_file(const std::string& bytes, const std::string& extension) {
  static const std::string stem = "/dev/shm/anigen_fuzz_" + std::to_string(::getpid());
  const fs::path path = stem + extension;
  std::ofstream(path, std::ios::binary | std::ios::trunc)
      .write(bytes.data(), static_cast<std::streamsize>(bytes.size()));
  static const bool registered =
      std::atexit([] {
        for (const char* each : {".ply", ".stl", ".3mf", ".npz", ".pt", ".safetensors", ".txt"})
          std::remove((stem + each).c_str());
      }) == 0;
  static_cast<void>(registered);
  return path;
}

void require(bool holds, const char* sentence) {
  if (holds) return;
  std::fprintf(stderr, "fuzz: %s\n", sentence);
  std::abort();
}

void check_mesh(const Mesh& mesh) {
  for (const auto& face : mesh.faces)
    for (int corner = 0; corner < 3; ++corner)
      require(face[corner] >= 0 && static_cast<std::size_t>(face[corner]) < mesh.vertices.size(),
              "a face names a vertex that does not exist");
}

io::ImportOptions small_assets() {
  io::ImportOptions options;
  options.max_vertices = options.max_faces = kMostVertices;
  options.require_rig = false;
  return options;
}

io::pickle::Source pickle_source() {
  io::pickle::Source source;
  source.file = "input.pkl";
  source.torch_storages = true;
  return source;
}

using Reader = void (*)(const std::string& bytes);

const std::map<std::string, Reader>& readers() {
  static const std::map<std::string, Reader> table{
      {"glb",
       [](const std::string& bytes) {
         check_mesh(io::read_gltf_bytes(bytes, "input.glb", small_assets()).asset.mesh);
       }},
      {"gltf",
       [](const std::string& bytes) {
         check_mesh(io::read_gltf_bytes(bytes, "input.gltf", small_assets()).asset.mesh);
       }},
      {"obj", [](const std::string& bytes) { io::parse_obj(bytes, "input.obj"); }},
      {"mtl", [](const std::string& bytes) { io::parse_mtl(bytes, "input.mtl"); }},
      {"ply", [](const std::string& bytes) { check_mesh(io::read_ply(as_file(bytes, ".ply"))); }},
      {"stl", [](const std::string& bytes) { check_mesh(io::read_stl(as_file(bytes, ".stl"))); }},
      {"three_mf",
       [](const std::string& bytes) {
         check_mesh(io::read_three_mf(as_file(bytes, ".3mf"), {kMostVertices, kMostVertices}));
       }},
      {"bvh", [](const std::string& bytes) { io::parse_bvh(bytes, "input.bvh"); }},
      {"npz", [](const std::string& bytes) { io::read_npz(as_file(bytes, ".npz")); }},
      {"npz_objects", [](const std::string& bytes) { io::read_npz_objects(as_file(bytes, ".npz")); }},
      {"pickle", [](const std::string& bytes) { io::pickle::load(bytes, pickle_source()); }},
      {"torch", [](const std::string& bytes) { io::read_torch_archive(as_file(bytes, ".pt")); }},
      {"safetensors", [](const std::string& bytes) { io::read_safetensors(as_file(bytes, ".safetensors")); }},
      {"text_rig", [](const std::string& bytes) { io::read_text_rig(as_file(bytes, ".txt"), "input"); }},
      {"json", [](const std::string& bytes) { parse_json(bytes, "input.json"); }},
      {"image",
       [](const std::string& bytes) {
         io::decode_image({bytes.begin(), bytes.end()}, "input.png");
       }},
  };
  return table;
}

Reader chosen = nullptr;

}  // namespace

extern "C" int LLVMFuzzerInitialize(int* /*argc*/, char*** argv) {
  std::string name = fs::path((*argv)[0]).filename().string();
  if (name.rfind("fuzz_", 0) == 0) name = name.substr(5);
  const auto found = readers().find(name);
  if (found == readers().end()) {
    std::fprintf(stderr, "fuzz: \"%s\" is none of:", name.c_str());
    for (const auto& [word, reader] : readers()) std::fprintf(stderr, " %s", word.c_str());
    std::fprintf(stderr, "\n");
    return std::exit(2), 0;
  }
  chosen = found->second;
  return 0;
}

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  try {
    chosen(std::string(reinterpret_cast<const char*>(data), size));
  } catch (const Error&) {
    // Refused with a reason.
  }
  return 0;
}
