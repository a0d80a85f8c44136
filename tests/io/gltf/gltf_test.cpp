// Broken and malicious glTF files: every one gives a clear error or a sound asset; nothing else.
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <limits>

#include "anigen/core/files.h"
#include "anigen/core/random.h"
#include "tests/io/file_fuzz.h"
#include "tests/io/gltf/gltf_import_support.h"

namespace anigen::io {
namespace {

namespace fs = std::filesystem;
using test::expect_refused;
using test::flag;
using test::GltfBuilder;

// A file whose bytes are given; the error's words are checked.
void expect_bytes_refused(const std::string& bytes, const std::string& place, const std::string& problem) {
  const test::TemporaryFolder folder;
  test::write_bytes(folder / "file.gltf", bytes);
  try {
    read_gltf(folder / "file.gltf");
    ADD_FAILURE() << "accepted; expected an error about: " << problem;
  } catch (const InputError& error) {
    EXPECT_NE(error.place().find(place), std::string::npos) << error.what();
    EXPECT_NE(error.problem().find(problem), std::string::npos) << error.what();
  }
}

// One change of the flag's JSON.
void expect_refused_with(const std::string& pointer, const Json& value, const std::string& place,
                         const std::string& problem) {
  GltfBuilder file = flag();
  file.json[Json::json_pointer(pointer)] = value;
  SCOPED_TRACE(pointer + " = " + value.dump());
  expect_refused(file, place, problem);
}

void put_u32(std::string& bytes, std::size_t offset, std::uint32_t value) {
  for (std::size_t i = 0; i < 4; ++i) bytes[offset + i] = static_cast<char>(value >> (8 * i) & 0xFF);
}

TEST(GltfHostile, FilesThatAreNoGltf) {
  expect_bytes_refused("", "byte 0", "empty");
  expect_bytes_refused("hello", "byte 0", "not a glTF file");
  expect_bytes_refused("[1, 2]", "byte 0", "not a glTF file");
  expect_bytes_refused("{\"asset\": {", "byte", "not valid JSON");
  expect_bytes_refused("{}", "/", "'asset' is missing");
  expect_bytes_refused("{\"asset\": {\"version\": \"2.0\"}}", "/skins", "no skin");
  expect_bytes_refused("{\"asset\": {\"version\": 1e999}}", "", "not valid JSON");
  expect_bytes_refused("version https://git-lfs.github.com/spec/v1\noid sha256:12\nsize 9\n", "byte 0", "git lfs pull");
  EXPECT_THROW(read_gltf("/no/such/file.glb"), InputError);
  EXPECT_THROW(read_gltf(fs::temp_directory_path()), InputError);
}

TEST(GltfHostile, DeepJson) {
  const std::string deep(10'000, '['), deeper = std::string(200'000, '{');
  expect_bytes_refused("{\"asset\": {\"version\": \"2.0\"}, \"extras\": " + deep, "byte", "nested deeper");
  expect_bytes_refused("{\"extras\": " + deep + std::string(10'000, ']') + "}", "byte", "nested deeper");
  expect_bytes_refused(deeper, "byte", "nested deeper");
}

TEST(GltfHostile, GlbHeaders) {
  const std::string good = flag().glb();
  std::string bytes = good;
  put_u32(bytes, 4, 1);
  expect_bytes_refused(bytes, "byte 4", "not supported: GLB version 1");
  for (const std::uint32_t length : {0u, 19u, 0xFFFFFFFFu, static_cast<std::uint32_t>(good.size()) + 1}) {
    bytes = good;
    put_u32(bytes, 8, length);
    expect_bytes_refused(bytes, "byte 8", "GLB header says");
  }
  bytes = good;
  put_u32(bytes, 12, 0xFFFFFFFF);
  expect_bytes_refused(bytes, "byte 12", "GLB chunk of 4294967295 bytes");
  bytes = good;
  put_u32(bytes, 16, 0x004E4942);
  expect_bytes_refused(bytes, "byte 16", "the first GLB chunk is not JSON");
  const std::string json_only = test::glb_of(flag().json.dump(), "");
  expect_bytes_refused(json_only, "", "");
}

TEST(GltfHostile, TruncatedAtEveryBoundaryAndElsewhere) {
  const fs::path real = test::assets_dir() / "rigged/fish/q_manta_ray.glb";
  std::string bytes = fs::exists(real) ? read_file(real) : flag().glb();
  std::vector<std::size_t> cuts = {0, 1, 3, 4, 8, 11, 12, 16, 19, 20, 21, bytes.size() - 1};
  std::uint32_t json_length = 0;
  for (std::size_t i = 0; i < 4; ++i)
    json_length |= static_cast<std::uint32_t>(static_cast<unsigned char>(bytes[12 + i])) << (8 * i);
  for (const std::size_t after : {0, 4, 8, 9}) cuts.push_back(20 + json_length + after);
  Rng rng(1, "truncated gltf");
  while (cuts.size() < 216) cuts.push_back(rng.index(bytes.size()));
  const test::TemporaryFolder folder;
  for (const std::size_t cut : cuts) {
    std::string part = bytes.substr(0, cut);
    test::write_bytes(folder / "cut.glb", part);
    EXPECT_THROW(read_gltf(folder / "cut.glb"), InputError) << cut;
    if (cut < 20) continue;
    put_u32(part, 8, static_cast<std::uint32_t>(cut));  // a header that agrees, so that later checks must notice
    test::write_bytes(folder / "cut.glb", part);
    EXPECT_THROW(read_gltf(folder / "cut.glb"), InputError) << cut;
  }
}

TEST(GltfHostile, NodeGraphs) {
  expect_refused_with("/nodes/2/children", {1}, "/nodes", "cycle");
  expect_refused_with("/nodes/2/children", {2}, "/nodes", "already is a child");
  expect_refused_with("/nodes/0/children", {0}, "/nodes", "cycle");
  expect_refused_with("/nodes/0/children", {2}, "/children/0", "already is a child");
  expect_refused_with("/nodes/0/children", {77}, "/nodes/0/children/0", "there is no node 77");
  expect_refused_with("/nodes/0/children", {-1}, "/nodes/0/children/0", "≥ 0");
  expect_refused_with("/scenes/0/nodes", {3}, "/scenes/0/nodes/0", "there is no node 3");
  expect_refused_with("/scene", 1, "/scene", "there is no scene 1");
}

TEST(GltfHostile, AVeryDeepNodeChainIsNoRecursion) {
  GltfBuilder file = flag();
  for (int n = 3; n < 60'000; ++n) file.json["nodes"].push_back({{"children", {n + 1}}});
  file.json["nodes"].push_back(Json::object());
  file.json["nodes"][2]["children"] = {3};
  EXPECT_NO_THROW(test::import_built(file));
}

TEST(GltfHostile, IndicesOutOfRange) {
  expect_refused_with("/nodes/0/mesh", 1, "/nodes/0/mesh", "there is no mesh 1");
  expect_refused_with("/nodes/0/skin", 5, "/nodes/0/skin", "there is no skin 5");
  expect_refused_with("/skins/0/joints", Json::array(), "/skins/0/joints", "no joints");
  expect_refused_with("/skins/0/joints/1", 99, "/skins/0/joints/1", "there is no node 99");
  expect_refused_with("/skins/0/joints/1", 1, "/skins/0/joints/1", "listed twice");
  expect_refused_with("/skins/0/skeleton", 99, "/skins/0/skeleton", "there is no node 99");
  expect_refused_with("/skins/0/inverseBindMatrices", 5, "/skins/0/inverseBindMatrices", "there is no accessor 5");
  expect_refused_with("/skins/0/inverseBindMatrices", 0, "/skins/0/inverseBindMatrices", "MAT4");
  expect_refused_with("/accessors/4/count", 1, "/skins/0/inverseBindMatrices", "1 inverse bind matrices for 2 joints");
  expect_refused_with("/meshes/0/primitives/0/material", 0, "/material", "there is no material 0");
  expect_refused_with("/meshes/0/primitives/0/indices", 9, "/indices", "there is no accessor 9");
  expect_refused_with("/meshes/0/primitives/0/indices", 0, "/indices", "unsigned SCALAR");
  expect_refused_with("/meshes/0/primitives/0/attributes/POSITION", 9, "/attributes/POSITION", "there is no accessor");
  expect_refused_with("/meshes/0/primitives/0/attributes/POSITION", 2, "/attributes/POSITION", "expected VEC3");
  expect_refused_with("/meshes/0/primitives/0/attributes/NORMAL", 3, "/attributes/NORMAL", "expected VEC3");
  expect_refused_with("/meshes/0/primitives/0/mode", 7, "/mode", "outside");
  expect_refused_with("/accessors/1/count", 3, "/attributes/JOINTS_0", "3 elements for 4 vertices");
  expect_refused_with("/accessors/0/count", 3, "/indices", "refers to vertex 3 of 3");
  expect_refused_with("/accessors/0/bufferView", 64, "/accessors/0/bufferView", "there is no bufferView 64");
  expect_refused_with("/bufferViews/0/buffer", 1, "/bufferViews/0/buffer", "there is no buffer 1");
}

TEST(GltfHostile, RangesAndCounts) {
  const std::uint64_t huge = std::uint64_t{1} << 40, most = ~std::uint64_t{0};
  for (const std::uint64_t count : {huge, most, most / 12 + 1}) {
    expect_refused_with("/accessors/0/count", count, "/accessors/0/count", "exceed the limit");
    expect_refused_with("/bufferViews/0/byteLength", count, "/bufferViews/0", "outside");
    expect_refused_with("/bufferViews/0/byteOffset", count, "/bufferViews/0", "outside");
    expect_refused_with("/accessors/0/byteOffset", count, "/accessors/0", "");
  }
  expect_refused_with("/accessors/0/count", 5, "/accessors/0", "5 elements need 60 bytes");
  expect_refused_with("/accessors/0/byteOffset", 4, "/accessors/0", "need 52 bytes");
  expect_refused_with("/bufferViews/0/byteStride", 13, "/accessors/0", "need 51 bytes");
  expect_refused_with("/bufferViews/0/byteStride", 4, "/accessors/0", "smaller than an element");
  expect_refused_with("/accessors/0/count", 1e30, "/accessors/0/count", "whole number");
  expect_refused_with("/accessors/0/count", -4, "/accessors/0/count", "≥ 0");
  expect_refused_with("/accessors/0/componentType", 5124, "/accessors/0/componentType", "unknown componentType");
  expect_refused_with("/accessors/0/type", "VEC5", "/accessors/0/type", "unknown type");

  GltfBuilder empty = flag();  // an accessor without data costs nothing, so only the limits hold it back
  empty.json["accessors"][0].erase("bufferView");
  empty.json["accessors"][0]["count"] = 20'000'001;
  empty.json["meshes"][0]["primitives"][0].erase("indices");
  expect_refused(empty, "", "limit");

  GltfBuilder sparse = flag();
  const int indices = sparse.view("\x09"), values = sparse.view(std::string(12, '\0'));
  sparse.json["accessors"][0]["sparse"] = {{"count", 1},
                                           {"indices", {{"bufferView", indices}, {"componentType", 5121}}},
                                           {"values", {{"bufferView", values}}}};
  expect_refused(sparse, "/accessors/0/sparse/indices", "sparse index 9 of 4");
  sparse.json["accessors"][0]["sparse"]["indices"]["byteOffset"] = most;
  expect_refused(sparse, "/sparse/indices/byteOffset", "outside");

  GltfBuilder buffer = flag();
  buffer.json["buffers"] = Json::array({Json{{"byteLength", huge}}});
  expect_refused(buffer, "/buffers/0/byteLength", "truncated data");
}

TEST(GltfHostile, NumbersThatAreNotFinite) {
  const float infinite = std::numeric_limits<float>::infinity();
  GltfBuilder file = flag();
  file.json["meshes"][0]["primitives"][0]["attributes"]["POSITION"] =
      file.floats({0, 0, 0, 1, 0, 0, 0, infinite, 0, 1, 2, 0}, "VEC3");
  expect_refused(file, "/attributes/POSITION", "vertex 2 is not finite");
  file = flag();
  file.json["skins"][0]["inverseBindMatrices"] = file.floats(std::vector<float>(32, NAN), "MAT4");
  expect_refused(file, "/skins/0/inverseBindMatrices", "none of the inverse bind matrices");
  expect_refused_with("/nodes/1/translation", {1e300, 1e300, 0}, "", "");
  expect_refused_with("/nodes/1/rotation", {0, 0, 0, 0}, "/nodes/1/rotation", "unit length");
  expect_refused_with("/nodes/1/matrix", Json::array({1, 2}), "/nodes/1/matrix", "expected 16 numbers");
  expect_refused_with("/nodes/1/matrix", Json(std::vector<double>(16, 1.0)), "/nodes/1/matrix", "0 0 0 1");
}

TEST(GltfHostile, WrongTypes) {
  for (const char* pointer : {"/asset",
                              "/scene",
                              "/scenes",
                              "/nodes",
                              "/nodes/1/children",
                              "/nodes/1/name",
                              "/skins",
                              "/nodes/2/translation",
                              "/skins/0/joints",
                              "/meshes",
                              "/meshes/0/primitives",
                              "/meshes/0/primitives/0/attributes",
                              "/accessors",
                              "/accessors/0/type",
                              "/accessors/0/normalized",
                              "/accessors/0/sparse",
                              "/bufferViews",
                              "/bufferViews/0",
                              "/buffers",
                              "/animations",
                              "/materials",
                              "/images",
                              "/textures",
                              "/extensionsRequired"}) {
    for (const Json& value : {Json(nullptr), Json(1.5), Json("text"), Json(true), Json::array({Json::array()}),
                              Json{{"key", Json::array()}}}) {
      GltfBuilder file = flag();
      file.json[Json::json_pointer(pointer)] = value;
      const test::TemporaryFolder folder;
      file.save(folder / "file.gltf");
      try {
        EXPECT_TRUE(validate(read_gltf(folder / "file.gltf").asset).empty()) << pointer << " = " << value;
      } catch (const InputError&) {  // some of these are valid: a name that is text
      }
    }
  }
}

TEST(GltfHostile, UrisThatLeaveTheFolder) {
  const test::TemporaryFolder outer;
  fs::create_directories(outer / "inner");
  GltfBuilder file = flag();
  test::write_bytes(outer / "secret.bin", file.buffer);
  test::write_bytes(outer / "inner/lfs.bin", "version https://git-lfs.github.com/spec/v1\n");
  const std::string absolute = (outer / "secret.bin").string();
  for (const std::string& uri :
       {std::string("../secret.bin"), std::string("%2e%2e/secret.bin"), std::string("..%2Fsecret.bin"),
        std::string("a/../../secret.bin"), std::string("..\\secret.bin"), absolute, "file://" + absolute,
        "%2F" + absolute.substr(1), std::string("http://example.com/a.bin"), std::string("https%3A//example.com/a"),
        std::string("c:/secret.bin"), std::string(""), std::string("a%00.bin"), std::string("lfs.bin"),
        std::string("missing.bin"), std::string("."), std::string("data:application/octet-stream;base64,@@@@"),
        std::string("data:nothing")}) {
    file.json["buffers"] = Json::array({Json{{"byteLength", file.buffer.size()}, {"uri", uri}}});
    test::write_bytes(outer / "inner/file.gltf", file.json.dump());
    EXPECT_THROW(read_gltf(outer / "inner/file.gltf"), InputError) << uri;
  }
  file = flag();
  file.json["images"] = Json::array({Json{{"uri", "../secret.bin"}}});
  expect_refused(file, "/images/0/uri", "leaves the folder");
}

// Both alphabets of RFC 4648 (sections 4 and 5), with their padding and without it.
TEST(GltfDataUri, EitherAlphabetOfBase64) {
  const test::TemporaryFolder folder;
  GltfBuilder file = flag();
  for (int i = 0; i < 256; ++i) file.buffer += static_cast<char>(i);  // every digit
  const std::string data_uri = Json::parse(file.gltf()).at("buffers").at(0).at("uri");
  const std::string digits = data_uri.substr(data_uri.find(',') + 1);
  std::string url_safe = digits;
  std::replace(url_safe.begin(), url_safe.end(), '+', '-');
  std::replace(url_safe.begin(), url_safe.end(), '/', '_');
  ASSERT_NE(url_safe, digits);
  test::write_bytes(folder / "plain.bin", file.buffer);
  const auto mesh_of = [&](const std::string& uri) {
    file.json["buffers"] = Json::array({Json{{"byteLength", file.buffer.size()}, {"uri", uri}}});
    test::write_bytes(folder / "file.gltf", file.json.dump());
    return read_gltf(folder / "file.gltf").asset.mesh.vertices;
  };
  const auto expected = mesh_of("plain.bin");
  for (std::string uri : {digits, url_safe}) {
    uri.erase(uri.find_last_not_of('=') + 1);
    for (const char* padding : {"", "=", "=="})
      EXPECT_EQ(mesh_of("data:application/octet-stream;base64," + uri + padding), expected) << padding;
  }
}

// A link beside the glTF may lead to a file that whoever made it was never given.
TEST(GltfHostile, LinksThatLeaveTheFolder) {
  const test::TemporaryFolder outer;
  fs::create_directories(outer / "inner/data");
  fs::create_directories(outer / "elsewhere");
  GltfBuilder file = flag();
  test::write_bytes(outer / "elsewhere/secret.bin", file.buffer);
  test::write_bytes(outer / "inner/data/own.bin", file.buffer);
  fs::create_symlink("../elsewhere/secret.bin", outer / "inner/secret.bin");
  fs::create_directory_symlink("../elsewhere", outer / "inner/folder");
  test::write_bytes(outer / "elsewhere/picture.png", "\x89PNG");
  fs::create_symlink("../elsewhere/picture.png", outer / "inner/picture.png");
  fs::create_symlink("data/own.bin", outer / "inner/own.bin");
  fs::create_directory_symlink("inner", outer / "also");
  const auto read = [&](const char* uri, const fs::path& folder) {
    file.json["buffers"] = Json::array({Json{{"byteLength", file.buffer.size()}, {"uri", uri}}});
    test::write_bytes(outer / "inner/file.gltf", file.json.dump());
    return read_gltf(folder / "file.gltf");
  };
  for (const char* uri : {"secret.bin", "folder/secret.bin", "data/../folder/secret.bin"}) {
    try {
      read(uri, outer / "inner");
      ADD_FAILURE() << "read " << uri;
    } catch (const InputError& error) {
      EXPECT_EQ(error.file(), (outer / "inner/file.gltf").string());
      EXPECT_EQ(error.place(), "/buffers/0/uri");
      EXPECT_NE(error.problem().find("the folder of the glTF file"), std::string::npos) << error.what();
    }
  }
  // Links that stay inside, and a folder that is a link itself, are what they were.
  EXPECT_EQ(read("own.bin", outer / "inner").asset.mesh.vertices.size(), 4u);
  EXPECT_EQ(read("own.bin", outer / "also").asset.mesh.vertices.size(), 4u);
  file.json["images"] = Json::array({Json{{"uri", "picture.png"}}});
  EXPECT_THROW(read("own.bin", outer / "inner"), InputError) << "also where no material uses the image";
}

TEST(GltfHostile, Animations) {
  const auto animated = [] {
    GltfBuilder file = flag();
    file.animate(2, "translation", {0, 1}, {0, 0, 0, 1, 1, 1});
    return file;
  };
  const auto refused = [&](const std::string& pointer, const Json& value, const std::string& problem) {
    GltfBuilder file = animated();
    file.json[Json::json_pointer("/animations/0" + pointer)] = value;
    SCOPED_TRACE(pointer);
    expect_refused(file, "/animations/0", problem);
  };
  refused("/channels/0/target/node", 9, "there is no node 9");
  refused("/channels/0/sampler", 1, "there is no sampler 1");
  refused("/channels/0/target/path", "colour", "unknown path");
  refused("/channels/0/target/path", "rotation", "expected VEC4");
  refused("/samplers/0/input", 99, "there is no accessor 99");
  refused("/samplers/0/input", 0, "SCALAR");
  refused("/samplers/0/output", 0, "4 values for 2 keys");
  refused("/samplers/0/interpolation", "MAGIC", "unknown interpolation");
  refused("/samplers/0/interpolation", "CUBICSPLINE", "2 values for 2 keys");
}

TEST(GltfHostile, CompressedData) {
  GltfBuilder file = flag();
  const Json ids = {{"POSITION", 0}};
  file.json["meshes"][0]["primitives"][0]["extensions"]["KHR_draco_mesh_compression"] = {{"bufferView", 0},
                                                                                         {"attributes", ids}};
  expect_refused(file, "KHR_draco_mesh_compression", "not Draco data");
  std::string claim = std::string("DRACO\x02\x02\x01\x01\x00\x00\x00", 12) + "\xFF\xFF\xFF\xFF\x0F\xFF\xFF\xFF\xFF\x0F";
  const int view = file.view(claim + std::string(40, '\x11'));
  file.json["meshes"][0]["primitives"][0]["extensions"]["KHR_draco_mesh_compression"]["bufferView"] = view;
  expect_refused(file, "KHR_draco_mesh_compression", "claims more vertices");

  const Json meshopt = {{"buffer", 0},      {"byteOffset", 0}, {"byteLength", 48},
                        {"byteStride", 12}, {"count", 4},      {"mode", "ATTRIBUTES"}};
  const auto refused = [&](const char* key, const Json& value, const std::string& problem) {
    GltfBuilder packed = flag();
    Json extension = meshopt;
    if (key[0] != '\0') extension[key] = value;
    packed.json["bufferViews"][0]["extensions"]["EXT_meshopt_compression"] = extension;
    SCOPED_TRACE(key);
    expect_refused(packed, "/bufferViews/0", problem);
  };
  refused("", nullptr, "cannot be decoded");
  refused("count", std::uint64_t{1} << 40, "outside");
  refused("count", 3, "byteLength 48");
  refused("byteStride", 6, "not allowed for mode");
  refused("mode", "TRIANGLES", "not allowed for mode");
  refused("mode", "OTHER", "unknown mode");
  refused("filter", "QUATERNION", "does not fit");
  refused("byteLength", std::uint64_t{1} << 39, "outside");
}

GltfBuilder rich_file() {
  GltfBuilder file = flag();
  file.json["meshes"][0]["primitives"][0]["attributes"]["NORMAL"] =
      file.floats({0, 0, 1, 0, 0, 1, 0, 0, 1, 0, 0, 1}, "VEC3");
  file.json["meshes"][0]["primitives"][0]["attributes"]["COLOR_0"] =
      file.u8(std::vector<std::uint8_t>(16, 200), "VEC4", true);
  file.json["materials"] = Json::array({Json{{"name", "m"}}});
  file.json["meshes"][0]["primitives"][0]["material"] = 0;
  file.animate(2, "rotation", {0, 1}, {0, 0, 0, 1, 0, 0, 1, 0});
  file.animate(1, "translation", {0, 1}, std::vector<float>(18, 0.5f), "CUBICSPLINE");
  return file;
}

// Reading may fail, but what it returns is sound.
void read_and_validate(const fs::path& path) {
  const std::vector<std::string> findings = validate(read_gltf(path).asset);
  EXPECT_TRUE(findings.empty()) << findings.front();
}

TEST(GltfHostile, FlippedBytes) {
  const test::TemporaryFolder folder;
  test::expect_errors_only(rich_file().glb(), folder / "fuzz.glb", read_and_validate, 600);
}

// Changes inside the compressed data, which the decoders must survive.
void damage_compressed(const std::string& name, std::size_t first, std::size_t length) {
  const fs::path real = test::assets_dir() / "rigged/negative" / name;
  if (!fs::exists(real)) {
    GTEST_SKIP() << real << " is not there";
  }
  const std::string bytes = read_file(real);
  std::size_t binary = 28;  // behind the JSON chunk and the header of the binary chunk
  for (std::size_t i = 0; i < 4; ++i)
    binary += static_cast<std::size_t>(static_cast<unsigned char>(bytes[12 + i])) << (8 * i);
  ASSERT_LE(binary + first + length, bytes.size());
  const test::TemporaryFolder folder;
  for (std::uint64_t i = 0; i < 150; ++i) {
    Rng rng(5, name, i);
    std::string damaged = bytes;
    // Half of the changes hit the headers, where they do most.
    const std::size_t reach = i % 2 == 0 ? std::min<std::size_t>(length, 60) : length;
    for (std::size_t n = 1 + rng.index(4); n > 0; --n)
      damaged[binary + first + rng.index(reach)] = static_cast<char>(rng.index(256));
    test::write_bytes(folder / "fuzz.glb", damaged);
    try {
      read_and_validate(folder / "fuzz.glb");
    } catch (const Error& error) {
      EXPECT_STRNE(error.what(), "");
    } catch (const std::exception& error) {
      ADD_FAILURE() << "copy " << i << " raised " << error.what();
    }
  }
}

TEST(GltfHostile, DamagedMeshoptData) { damage_compressed("neg_meshopt_triangles.glb", 0, 256); }
// The second, smaller mesh, so that a run is quick.
TEST(GltfHostile, DamagedDracoData) { damage_compressed("neg_draco_flamingo.glb", 137979, 9110); }

TEST(GltfHostile, MutatedJson) {
  const GltfBuilder good = rich_file();
  const Json flat = good.json.flatten();
  std::vector<std::string> pointers;
  for (const auto& item : flat.items()) pointers.push_back(item.key());
  const std::vector<Json> values = {nullptr,
                                    -1,
                                    0,
                                    1,
                                    2,
                                    3,
                                    7,
                                    5121,
                                    5126,
                                    1e300,
                                    -0.5,
                                    "VEC3",
                                    "",
                                    true,
                                    std::uint64_t{1} << 40,
                                    Json::array(),
                                    Json::object(),
                                    Json::array({0, 0, 0})};
  const test::TemporaryFolder folder;
  for (std::uint64_t i = 0; i < 600; ++i) {
    Rng rng(11, "gltf json", i);
    GltfBuilder file = good;
    for (std::size_t n = 1 + rng.index(3); n > 0; --n) {
      std::string pointer = pointers[rng.index(pointers.size())];
      if (rng.chance(0.3)) pointer = pointer.substr(0, pointer.rfind('/'));
      try {
        file.json.at(Json::json_pointer(pointer)) = values[rng.index(values.size())];
      } catch (const Json::exception&) {  // an earlier change removed this place
      }
    }
    if (!file.json.is_object()) continue;
    file.save(folder / "fuzz.glb");
    try {
      read_and_validate(folder / "fuzz.glb");
    } catch (const Error& error) {
      EXPECT_STRNE(error.what(), "");
    } catch (const std::exception& error) {
      ADD_FAILURE() << "mutation " << i << " raised " << error.what();
    }
  }
}

}  // namespace
}  // namespace anigen::io
