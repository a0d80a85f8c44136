#include <cstdio>
#include <cstdlib>
#include <cstring>
#include <fstream>

#include "anigen/core/config.h"
#include "anigen/core/error.h"
#include "anigen/core/private_folder.h"
#include "anigen/io/arrays/npz.h"
#include "anigen/io/arrays/pickle.h"
#include "anigen/io/arrays/safetensors.h"
#include "anigen/io/arrays/torch_archive.h"
#include "anigen/io/gltf/gltf.h"
#include "anigen/io/image.h"
#include "anigen/io/mtl.h"
#include "anigen/io/obj.h"
#include "anigen/io/onnx.h"
#include "anigen/io/ply.h"
#include "anigen/io/rigs/bvh.h"
#include "anigen/io/rigs/text_rig.h"
#include "anigen/io/stl.h"
#include "anigen/io/three_mf.h"
#include "fuzz/targets.h"

namespace anigen::fuzz {

namespace {

constexpr std::size_t kMostVertices = 1'000'000;

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

void read_gltf(const std::string& bytes, const char* name) {
  check_mesh(io::read_gltf_bytes(bytes, name, small_assets()).asset.mesh);
}

io::pickle::Source pickle_source() {
  io::pickle::Source source;
  source.file = "input.pkl";
  source.torch_storages = true;
  return source;
}

void append_number(std::string& to, std::uint32_t number) {
  for (int shift = 0; shift < 32; shift += 8) to += static_cast<char>(number >> shift & 0xFF);
}

/// A GLB file of a JSON text and a binary chunk.
std::string glb_of(const Json& json, const std::string& binary) {
  std::string text = json.dump(), data = binary;
  text.resize((text.size() + 3) / 4 * 4, ' ');
  data.resize((data.size() + 3) / 4 * 4, '\0');
  std::string glb = "glTF";
  append_number(glb, 2);
  append_number(glb, static_cast<std::uint32_t>(28 + text.size() + data.size()));
  append_number(glb, static_cast<std::uint32_t>(text.size()));
  glb += "JSON" + text;
  append_number(glb, static_cast<std::uint32_t>(data.size()));
  return glb + std::string("BIN\0", 4) + data;
}

/// glTF of one mesh, whose views and primitive are given.
Json one_mesh(Json views, Json accessors, Json primitive, std::size_t buffer_bytes, const char* extension) {
  return {{"asset", {{"version", "2.0"}}},
          {"extensionsUsed", {extension}},
          {"extensionsRequired", {extension}},
          {"scenes", Json::array({{{"nodes", {0}}}})},
          {"nodes", Json::array({{{"mesh", 0}}})},
          {"meshes", Json::array({{{"primitives", Json::array({std::move(primitive)})}}})},
          {"accessors", std::move(accessors)},
          {"bufferViews", std::move(views)},
          {"buffers", Json::array({{{"byteLength", buffer_bytes}}})}};
}

/// A number of the input's first bytes, which leave it.
std::size_t take_number(std::string& bytes, std::size_t size) {
  std::size_t number = 0;
  for (std::size_t i = 0; i < size && i < bytes.size(); ++i)
    number |= static_cast<std::size_t>(static_cast<unsigned char>(bytes[i])) << 8 * i;
  bytes.erase(0, size);
  return number;
}

/// Draco data behind two numbers of 16 bits: vertices and triangles that the file claims.
void read_draco(std::string bytes) {
  const std::size_t vertices = 1 + take_number(bytes, 2), triangles = 1 + take_number(bytes, 2);
  const Json draco{{"bufferView", 0}, {"attributes", {{"POSITION", 0}, {"TEXCOORD_0", 1}, {"JOINTS_0", 2}}}};
  const Json primitive{{"attributes", {{"POSITION", 0}, {"TEXCOORD_0", 2}}},
                       {"indices", 1},
                       {"extensions", {{"KHR_draco_mesh_compression", draco}}}};
  const Json accessors = Json::array({{{"componentType", 5126}, {"count", vertices}, {"type", "VEC3"}},
                                      {{"componentType", 5125}, {"count", 3 * triangles}, {"type", "SCALAR"}},
                                      {{"componentType", 5126}, {"count", vertices}, {"type", "VEC2"}}});
  const Json views = Json::array({{{"buffer", 0}, {"byteLength", bytes.size()}}});
  read_gltf(glb_of(one_mesh(views, accessors, primitive, bytes.size(), "KHR_draco_mesh_compression"), bytes),
            "input.glb");
}

/// Meshopt data behind a byte that chooses mode and filter, and the number of elements in 16 bits. Decoded data are the
/// positions, or the indices of 256 vertices at 0.
void read_meshopt(std::string bytes) {
  const std::size_t choice = take_number(bytes, 1);
  std::size_t count = 1 + take_number(bytes, 2);
  constexpr const char *kModes[] = {"ATTRIBUTES", "TRIANGLES", "INDICES"},
                       *kFilters[] = {"NONE", "OCTAHEDRAL", "QUATERNION", "EXPONENTIAL"};
  constexpr std::size_t kVertices = 256;
  const std::size_t mode = choice % 3, filter = mode == 0 ? choice / 3 % 4 : 0;
  const bool wide = choice / 12 % 2 == 1;
  if (mode == 1) count = (count + 2) / 3 * 3;
  const std::size_t stride = mode == 0 ? (filter == 1 || filter == 2 ? 8 : wide ? 16 : 12) : wide ? 4 : 2;
  const Json packed{{"buffer", 0},    {"byteLength", bytes.size()}, {"byteStride", stride},
                    {"count", count}, {"mode", kModes[mode]},       {"filter", kFilters[filter]}};
  Json view{{"buffer", 0}, {"byteLength", count * stride}, {"extensions", {{"EXT_meshopt_compression", packed}}}};
  Json accessors, primitive;
  if (mode == 0) {
    view["byteStride"] = stride;
    const bool floats = filter == 0 || filter == 3;
    accessors = Json::array({{{"bufferView", 0},
                              {"componentType", floats ? 5126 : 5122},
                              {"normalized", !floats},
                              {"count", count},
                              {"type", "VEC3"}}});
    primitive = {{"attributes", {{"POSITION", 0}}}};
  } else {
    accessors =
        Json::array({{{"componentType", 5126}, {"count", kVertices}, {"type", "VEC3"}},
                     {{"bufferView", 0}, {"componentType", wide ? 5125 : 5123}, {"count", count}, {"type", "SCALAR"}}});
    primitive = {{"attributes", {{"POSITION", 0}}}, {"indices", 1}};
  }
  read_gltf(glb_of(one_mesh(Json::array({view}), accessors, primitive, bytes.size(), "EXT_meshopt_compression"), bytes),
            "input.glb");
}

}  // namespace

void require(bool holds, const char* sentence) {
  if (holds) return;
  std::fprintf(stderr, "fuzz: %s\n", sentence);
  std::abort();
}

std::string as_file(const std::string& bytes, const std::string& extension) {
  static const PrivateFolder folder;
  const std::string path = folder / ("input" + extension);
  std::ofstream(path, std::ios::binary | std::ios::trunc)
      .write(bytes.data(), static_cast<std::streamsize>(bytes.size()));
  return path;
}

void run(Target target, const std::string& bytes) {
  try {
    target(bytes);
  } catch (const Error&) {
    // Refused with a reason.
  }
}

std::map<std::string, Target> targets() {
  std::map<std::string, Target> table{
      {"glb", [](const std::string& bytes) { read_gltf(bytes, "input.glb"); }},
      {"gltf", [](const std::string& bytes) { read_gltf(bytes, "input.gltf"); }},
      {"draco", [](const std::string& bytes) { read_draco(bytes); }},
      {"meshopt", [](const std::string& bytes) { read_meshopt(bytes); }},
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
      {"onnx",
       [](const std::string& bytes) {
         io::read_onnx_signature(as_file(bytes, ".onnx"));
         io::onnx_in_full_precision(bytes, "input.onnx");
       }},
  };
#ifdef ANIGEN_WITH_STUDIO
  table.merge(program_targets());
#endif
  return table;
}

}  // namespace anigen::fuzz
