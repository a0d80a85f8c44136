#include <cstdio>
#include <cstdlib>
#include <cstring>
#include <fstream>
#include <memory>

#include "anigen/core/config.h"
#include "anigen/core/error.h"
#include "anigen/core/private_folder.h"
#include "anigen/io/arrays/npz.h"
#include "anigen/io/arrays/npz_samples.h"
#include "anigen/io/arrays/pickle.h"
#include "anigen/io/arrays/safetensors.h"
#include "anigen/io/arrays/torch_archive.h"
#include "anigen/io/gltf/gltf.h"
#include "anigen/io/image.h"
#include "anigen/io/mtl.h"
#include "anigen/io/obj.h"
#include "anigen/io/onnx.h"
#include "anigen/io/picture_codec.h"
#include "anigen/io/ply.h"
#include "anigen/io/rigs/bvh.h"
#include "anigen/io/rigs/text_rig.h"
#include "anigen/io/stl.h"
#include "anigen/io/three_mf.h"
#include "fuzz/targets.h"

namespace anigen::fuzz {

namespace {

constexpr std::size_t kMostVertices = 1'000'000;

/// Calls one more reader of an input. What it refuses does not keep the next from reading.
template <typename Read>
void also(Read read) {
  try {
    read();
  } catch (const Error&) {
  }
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

void read_glb(const std::string& bytes) {
  check_mesh(io::read_gltf_bytes(bytes, "input.glb", small_assets()).asset.mesh);
}

/// A file of its own, beside which buffers and images may lie.
void read_gltf(const std::string& bytes) {
  check_mesh(io::read_gltf(as_file(bytes, ".gltf"), small_assets()).asset.mesh);
}

/// The path of a ZIP archive. Bytes that are none become one member of one: its checksum holds whatever they are.
std::string as_archive(const std::string& bytes, const std::string& extension, const std::string& member,
                       std::vector<io::ZipContent> others = {}) {
  const std::string path = as_file(bytes, extension);
  if (bytes.compare(0, 2, "PK") == 0) return path;
  others.insert(others.begin(), {member, bytes});
  io::write_zip(path, others);
  return path;
}

void read_npz(const std::string& bytes) {
  const std::string path = as_archive(bytes, ".npz", "array.npy");
  also([&] { io::read_npz(path); });
  for (const auto& [name, array] : io::read_npz_headers(path))
    also([&, &wanted = name] { io::read_npz(path, {wanted}); });
}

void read_npz_objects(const std::string& bytes) {
  const std::string path = as_archive(bytes, ".npz", "array.npy");
  also([&] {
    const std::unique_ptr<const io::NpzSamples> samples = io::NpzSamples::open(path, "name");
    for (std::size_t i = 0; samples && i < samples->size() && i < 16; ++i) samples->read(i);
  });
  also([&] { io::read_npz(path); });
  for (const auto& [name, value] : io::read_npz_objects(path)) value.find("name");
}

void read_torch(const std::string& bytes) {
  const std::string path = as_archive(bytes, ".pt", "archive/data.pkl",
                                      {{"archive/data/1", std::string(6, '\1')},
                                       {"archive/data/2", std::string(12, '\x3f')},
                                       {"archive/data/4", std::string(24, '\x3f')},
                                       {"archive/data/8", std::string(48, '\x3f')},
                                       {"archive/version", "3\n"}});
  also([&] { io::read_state_dict(path); });
  also([&] { io::read_state_below(path, "model."); });
  also([&] { io::read_torch_checkpoint(path, "config"); });
  io::read_torch_archive(path);
}

void read_painted(const std::string& bytes) {
  static const bool beside = [] {
    const std::vector<std::uint8_t> png = io::encode_png(io::Image(2, 2));
    as_file({png.begin(), png.end()}, ".png");
    return true;
  }();
  static_cast<void>(beside);
  as_file(bytes, ".mtl");
  check_mesh(
      io::read_painted_obj(as_file("mtllib input.mtl\nv 0 0 0\nv 1 0 0\nv 0 1 0\nvt 0 0\nusemtl a\nf 1/1 2/1 3/1\n"
                                   "usemtl b\nf 1/1 3/1 2/1\nusemtl a\nf 3/1 2/1 1/1\n",
                                   ".obj"))
          .mesh);
}

void read_obj(const std::string& bytes) {
  const std::string path = as_file(bytes, ".obj");
  also([&] { io::read_painted_obj(path); });
  check_mesh(io::read_obj(path));
}

void read_text_rig(const std::string& bytes) {
  as_file("v 0 0 0\nv 1 0 0\nv 0 1 0\nv 0 0 1\nf 1 2 3\nf 1 3 4\n", ".obj");
  const std::string path = as_file(bytes, ".txt");
  io::is_text_rig(path);
  const std::string alone = as_file(bytes, ".alone.txt");  // no mesh has its name
  also([&] { io::read_text_rig(alone, "input"); });
  io::read_text_rig(path, "input");
}

void read_image(const std::string& bytes) {
  const std::vector<std::uint8_t> file(bytes.begin(), bytes.end());
  constexpr std::uint64_t kMostPixels = 1 << 22;
  const int orientation = io::exif_orientation(file);
  require(orientation >= 1 && orientation <= 8, "an orientation that EXIF does not know");
  const io::PictureSize size = io::probe_picture(file, "input.png");
  if (size.known && size.width * size.height > kMostPixels) return;
  io::StoredPixels stored;
  // Lean builds decode by it.
  io::Image by_stb;
  io::Grey16 grey_by_stb;
  io::stb_codec().decode(file, by_stb, stored);
  io::stb_codec().decode_grey16(file, grey_by_stb, stored);
  const io::Image image = io::decode_image(file, "input.png", &stored);
  io::has_transparency(image);
  const io::Image turned = io::upright(image, orientation);
  require(turned.rgba.size() == image.rgba.size(), "a picture turned upright has other pixels");
}

/// A config: read with what it extends, changed by its own list "set", and asked for each of its keys in every way.
void read_config(const std::string& bytes) {
  const Json config = parse_json(bytes, "input.json");
  static const std::string base = as_file(R"({"a": {"name": "x", "b": [1, {"c": 2}]}, "d": "text"})", ".base");
  also([&] { load_config(as_file(bytes, ".json")); });
  if (!config.is_object()) return;
  ConfigRecord record;
  ConfigReader reader(config, "input.json");
  for (const auto& [name, value] : config.items()) {
    const std::string& key = name;
    also([&] { reader.integer(key, 0, -5, 5); });
    also([&] { reader.number(key, 0, -5, 5); });
    also([&] { reader.boolean(key, false); });
    also([&] { reader.text(key, ""); });
    also([&] { reader.choice(key, "one", {"one", "another"}); });
    also([&] { reader.integers(key, {}); });
    also([&] { reader.numbers(key, {}); });
    also([&] { reader.texts(key, {}); });
    also([&] { reader.object(key).finish(); });
    also([&] { reader.require(key + "s"); });
    reader.raw(key);
  }
  also([&] { ConfigReader(config, "input.json").finish(); });
  also([&] {
    ConfigReader others(config, "input.json");
    for (const char* key : {"joints", "name", "steps", "seed"}) others.ignore(key);
    for (const char* key : {"method", "radius", "names"}) others.text(key, "");
    others.finish();
  });
  reader.finish();
  record.completed(config);
  Json changed = config;
  if (const auto set = config.find("set"); set != config.end() && set->is_array()) {
    for (const Json& assignment : *set) {
      if (assignment.is_string()) also([&] { apply_override(changed, assignment.get<std::string>()); });
    }
  }
  merge_config(changed, config);
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
  const Json draco{{"bufferView", 0}, {"attributes", {{"POSITION", 0}, {"TEXCOORD_0", 1}, {"NORMAL", 2}}}};
  const Json primitive{{"attributes", {{"POSITION", 0}, {"TEXCOORD_0", 2}, {"NORMAL", 0}}},
                       {"indices", 1},
                       {"extensions", {{"KHR_draco_mesh_compression", draco}}}};
  const Json accessors = Json::array({{{"componentType", 5126}, {"count", vertices}, {"type", "VEC3"}},
                                      {{"componentType", 5125}, {"count", 3 * triangles}, {"type", "SCALAR"}},
                                      {{"componentType", 5126}, {"count", vertices}, {"type", "VEC2"}}});
  const Json views = Json::array({{{"buffer", 0}, {"byteLength", bytes.size()}}});
  read_glb(glb_of(one_mesh(views, accessors, primitive, bytes.size(), "KHR_draco_mesh_compression"), bytes));
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
  read_glb(glb_of(one_mesh(Json::array({view}), accessors, primitive, bytes.size(), "EXT_meshopt_compression"), bytes));
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
  static const bool says = std::getenv("ANIGEN_FUZZ_SAYS") != nullptr;
  try {
    target(bytes);
    if (says) std::fprintf(stderr, "taken\n");
  } catch (const Error& refusal) {
    if (says) std::fprintf(stderr, "refused: %s\n", refusal.what());
  }
}

std::map<std::string, Target> targets() {
  std::map<std::string, Target> table{
      {"glb", read_glb},
      {"gltf", read_gltf},
      {"draco", [](const std::string& bytes) { read_draco(bytes); }},
      {"meshopt", [](const std::string& bytes) { read_meshopt(bytes); }},
      {"obj", read_obj},
      {"mtl", read_painted},
      {"ply", [](const std::string& bytes) { check_mesh(io::read_ply(as_file(bytes, ".ply"))); }},
      {"stl", [](const std::string& bytes) { check_mesh(io::read_stl(as_file(bytes, ".stl"))); }},
      {"three_mf",
       [](const std::string& bytes) {
         check_mesh(io::read_three_mf(as_archive(bytes, ".3mf", "3D/3dmodel.model"), {kMostVertices, kMostVertices}));
       }},
      {"bvh", [](const std::string& bytes) { io::parse_bvh(bytes, "input.bvh"); }},
      {"npz", read_npz},
      {"npz_objects", read_npz_objects},
      {"pickle", [](const std::string& bytes) { io::pickle::load(bytes, pickle_source()); }},
      {"torch", read_torch},
      {"safetensors",
       [](const std::string& bytes) {
         const std::string path = as_file(bytes, ".safetensors");
         also([&] { io::read_safetensors_metadata(path); });
         also([&] { io::read_state_dict(path); });
         io::read_safetensors(path);
       }},
      {"text_rig", read_text_rig},
      {"json", read_config},
      {"image", read_image},
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
