#include "anigen/io/ply.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cstring>
#include <fstream>
#include <limits>
#include <string>

#include "anigen/core/error.h"
#include "anigen/core/files.h"
#include "tests/io/file_fuzz.h"
#include "tests/io/small_asset.h"
#include "tests/support/paths.h"

namespace anigen::io {
namespace {

Mesh parsed_ply(const std::string& bytes) {
  const test::TemporaryFolder folder;
  std::ofstream(folder / "mesh.ply", std::ios::binary) << bytes;
  return read_ply(folder / "mesh.ply");
}

std::string ply_complaint(const std::string& bytes) {
  try {
    parsed_ply(bytes);
  } catch (const InputError& error) {
    return error.place() + ": " + error.problem();
  }
  return "no error";
}

template <typename T>
std::string stored(T value, bool big_endian) {
  std::string bytes(sizeof(T), '\0');
  std::memcpy(bytes.data(), &value, sizeof(T));  // the tests run on little-endian machines
  if (big_endian) std::reverse(bytes.begin(), bytes.end());
  return bytes;
}

const std::string kXyz = "property float x\nproperty float y\nproperty float z\n";
const std::string kFaces = "property list uchar int vertex_indices\n";

std::string ascii(const std::string& properties, const std::string& rows, const std::string& faces = "") {
  const auto lines = [](const std::string& text) { return std::to_string(std::count(text.begin(), text.end(), '\n')); };
  return "ply\nformat ascii 1.0\ncomment made by hand\nobj_info none\nelement vertex " + lines(rows) + "\n" +
         properties + (faces.empty() ? "" : "element face " + lines(faces) + "\n" + kFaces) + "end_header\n" + rows +
         faces;
}

const std::string kRows = "0 0 0\n1 0 0\n0 1 0\n0 0 1\n";

TEST(Ply, ReadsText) {
  const Mesh mesh = parsed_ply(ascii(kXyz, kRows, "3 0 1 2\n4 0 1 2 3\n"));
  ASSERT_EQ(mesh.vertices.size(), 4u);
  EXPECT_EQ(mesh.vertices[3], Eigen::Vector3f(0, 0, 1));
  EXPECT_EQ(mesh.faces, (std::vector<Triangle>{{0, 1, 2}, {0, 1, 2}, {0, 2, 3}}));
  EXPECT_TRUE(mesh.normals.empty() && mesh.uvs.empty() && mesh.colors.empty());
}

TEST(Ply, ReadsCarriageReturns) {
  std::string text = ascii(kXyz, kRows, "3 0 1 2\n"), with_returns;
  for (const char c : text) with_returns += c == '\n' ? std::string("\r\n") : std::string(1, c);
  EXPECT_EQ(parsed_ply(with_returns).faces.size(), 1u);
}

TEST(Ply, AFileWithoutFacesIsAPointCloud) {
  const Mesh mesh = parsed_ply(ascii(kXyz, "0 0 0\n1 2 3\n"));
  EXPECT_EQ(mesh.vertices.size(), 2u);
  EXPECT_TRUE(mesh.faces.empty());
}

TEST(Ply, ReadsNormalsColoursAndTextureCoordinatesInAnyOrder) {
  const Mesh mesh = parsed_ply(
      ascii("property uchar red\nproperty double z\nproperty float nz\nproperty list uchar float extra\n"
            "property ushort green\nproperty int8 y\nproperty float nx\nproperty float blue\nproperty short x\n"
            "property float ny\nproperty float quality\nproperty float s\nproperty float t\n",
            "255 3 4 2 7 8 65535 2 0 0.5 1 3 nan 0.25 0.25\n"));
  EXPECT_EQ(mesh.vertices[0], Eigen::Vector3f(1, 2, 3));
  EXPECT_LT((mesh.normals[0] - Eigen::Vector3f(0, 0.6f, 0.8f)).norm(), 1e-6f);
  EXPECT_EQ(mesh.colors[0], Eigen::Vector4f(1, 1, 0.5f, 1));
  EXPECT_EQ(mesh.uvs[0], Eigen::Vector2f(0.25f, 0.75f));
}

class PlyBinary : public ::testing::TestWithParam<bool> {};

TEST_P(PlyBinary, ReadsEveryType) {
  const bool big = GetParam();
  // Elements nobody knows stand before and between the known ones; every scalar and list type occurs.
  std::string bytes = std::string("ply\nformat ") + (big ? "binary_big_endian" : "binary_little_endian") + " 1.0\n" +
                      "element camera 1\nproperty char a\nproperty uchar b\nproperty short c\nproperty ushort d\n" +
                      "property list int double e\nelement vertex 3\nproperty double x\nproperty int y\n" +
                      "property uint z\nproperty uint8 red\nproperty uint8 green\nproperty uint8 blue\n" +
                      "property uint8 alpha\nelement nothing 1000000000\n" +
                      "element face 1\nproperty float area\nproperty list uint16 uint32 vertex_index\n" +
                      "property list int16 int8 flags\nend_header\n";
  bytes += stored<std::int8_t>(-1, big) + stored<std::uint8_t>(1, big) + stored<std::int16_t>(-2, big) +
           stored<std::uint16_t>(2, big) + stored<std::int32_t>(2, big) + stored(1.5, big) + stored(2.5, big);
  for (int v = 0; v < 3; ++v) {
    bytes += stored(0.25 + v, big) + stored<std::int32_t>(-v, big) + stored<std::uint32_t>(3000000000u, big) +
             stored<std::uint8_t>(51, big) + std::string(3, '\xff');
  }
  bytes += stored(1.0f, big) + stored<std::uint16_t>(3, big);
  for (const std::uint32_t v : {2u, 0u, 1u}) bytes += stored(v, big);
  bytes += stored<std::int16_t>(2, big) + "ab";
  const Mesh mesh = parsed_ply(bytes);
  EXPECT_EQ(mesh.vertices[2], Eigen::Vector3f(2.25f, -2.0f, 3e9f));
  EXPECT_EQ(mesh.colors[1], Eigen::Vector4f(0.2f, 1, 1, 1));
  EXPECT_EQ(mesh.faces, (std::vector<Triangle>{{2, 0, 1}}));
  for (std::size_t cut = 1; cut < 60; ++cut)
    EXPECT_THROW(parsed_ply(bytes.substr(0, bytes.size() - cut)), InputError) << cut << " bytes missing";
}

INSTANTIATE_TEST_SUITE_P(Endian, PlyBinary, ::testing::Bool(),
                         [](const auto& info) { return std::string(info.param ? "big" : "little"); });

TEST(Ply, ErrorsNameThePlace) {
  EXPECT_EQ(ply_complaint("solid\n"), "line 1: not a PLY file: the first line is not 'ply'");
  EXPECT_EQ(ply_complaint(""), "line 1: the header is cut short");
  EXPECT_EQ(ply_complaint("ply\nformat ascii 1.0\n"), "line 2: the header is cut short");
  EXPECT_EQ(ply_complaint("ply\nformat ascii 2.0\n"), "line 2: unknown PLY version '2.0'");
  EXPECT_EQ(ply_complaint("ply\nformat morse 1.0\n"), "line 2: unknown format 'morse'");
  EXPECT_EQ(ply_complaint("ply\nhello\n"), "line 2: unknown keyword 'hello'");
  EXPECT_EQ(ply_complaint("ply\nend_header\n"), "line 2: the header names no format");
  EXPECT_EQ(ply_complaint("ply\nproperty float x\n"), "line 2: a property before the first element");
  EXPECT_EQ(ply_complaint("ply\nelement vertex -1\n"), "line 2: an element needs a name and a count");
  EXPECT_EQ(ply_complaint("ply\nelement vertex 1\nproperty quad x\n"), "line 3: unknown type 'quad'");
  EXPECT_EQ(ply_complaint("ply\nelement face 1\nproperty list float int vertex_indices\n"),
            "line 3: the length of a list must be an integer type");
  EXPECT_EQ(ply_complaint(ascii(kXyz, kRows, "3 0 1 4\n")), "line 16: a face refers to vertex 4 of 4");
  EXPECT_EQ(ply_complaint(ascii(kXyz, kRows, "3 0 1 -1\n")), "line 16: a face refers to vertex -1 of 4");
  EXPECT_EQ(ply_complaint(ascii(kXyz, kRows, "2 0 1 2\n")), "line 16: a face needs at least 3 corners, found 2");
  EXPECT_EQ(ply_complaint(ascii(kXyz, kRows, "3 0 1 1.5\n")), "line 16: '1.5' does not fit its integer type");
  EXPECT_EQ(ply_complaint(ascii(kXyz, "0 0 zero\n")), "line 10: 'zero' is not a number");
  EXPECT_EQ(ply_complaint(ascii(kXyz, "0 0 nan\n")), "line 10: a vertex has a number that is not finite");
  EXPECT_EQ(ply_complaint(ascii("property float x\nproperty float y\n", "0 0\n")), ": vertices without x, y and z");
  EXPECT_EQ(ply_complaint("ply\nformat ascii 1.0\nelement vertex 0\n" + kXyz + "end_header\n"), ": no vertices");
}

TEST(Ply, HostileCountsAreRefusedBeforeAnythingIsAllocated) {
  for (const char* format : {"ascii", "binary_little_endian"}) {
    const std::string head = std::string("ply\nformat ") + format + " 1.0\n";
    for (const char* count : {"4000000000", "9000000000000000", "1e15"}) {
      const std::string problem = ply_complaint(head + "element vertex " + count + "\n" + kXyz + "end_header\n0 0 0\n");
      EXPECT_NE(problem.find("more than the file can hold"), std::string::npos) << problem;
    }
  }
  const std::string list = "ply\nformat binary_little_endian 1.0\nelement vertex 1\n" + kXyz +
                           "element face 1\nproperty list uint int vertex_indices\nend_header\n" +
                           std::string(12, '\0') + "\xff\xff\xff\xff";
  EXPECT_NE(ply_complaint(list).find("a list of 4294967295 items reaches beyond the end"), std::string::npos);
  EXPECT_NE(ply_complaint("ply\n" + std::string(2u << 20, 'x')).find("no end_header within 1 MiB"), std::string::npos);
}

TEST(Ply, TriangleStripsAreNamedAsNotSupported) {
  EXPECT_THROW(parsed_ply("ply\nformat ascii 1.0\nelement vertex 3\n" + kXyz +
                          "element tristrips 1\nproperty list int int vertex_indices\nend_header\n" +
                          "0 0 0\n1 0 0\n0 1 0\n3 0 1 2\n"),
               NotSupportedError);
}

TEST(Ply, RoundTrip) {
  Mesh mesh = test::small_asset(3, 9).mesh;
  mesh.face_materials.clear();
  const test::TemporaryFolder folder;
  write_ply(folder / "mesh.ply", mesh);
  const Mesh again = read_ply(folder / "mesh.ply");
  EXPECT_EQ(again.vertices, mesh.vertices);
  EXPECT_EQ(again.faces, mesh.faces);
  ASSERT_EQ(again.normals.size(), mesh.normals.size());
  ASSERT_EQ(again.uvs.size(), mesh.uvs.size());
  ASSERT_EQ(again.colors.size(), mesh.colors.size());
  for (std::size_t v = 0; v < mesh.vertices.size(); ++v) {
    EXPECT_LT((again.normals[v] - mesh.normals[v]).norm(), 2e-7f);
    EXPECT_LT((again.uvs[v] - mesh.uvs[v]).norm(), 2e-7f);
    EXPECT_LE((again.colors[v] - mesh.colors[v]).cwiseAbs().maxCoeff(), 0.5f / 255.0f + 1e-6f);  // eight bits
  }
}

TEST(Ply, RoundTripOfAPointCloud) {
  Mesh mesh;
  mesh.vertices = {{1, 2, 3}, {-1e-20f, 1e20f, 0.1f}};
  const test::TemporaryFolder folder;
  write_ply(folder / "cloud.ply", mesh);
  const Mesh again = read_ply(folder / "cloud.ply");
  EXPECT_EQ(again.vertices, mesh.vertices);
  EXPECT_TRUE(again.faces.empty());
}

TEST(Ply, RefusesToWriteAnUnsoundMesh) {
  const test::TemporaryFolder folder;
  Mesh mesh = test::small_asset().mesh;
  mesh.vertices[0].x() = std::numeric_limits<float>::infinity();
  EXPECT_THROW(write_ply(folder / "mesh.ply", mesh), InputError);
  EXPECT_THROW(write_ply(folder / "mesh.ply", Mesh()), InputError);
  EXPECT_TRUE(std::filesystem::is_empty(folder.path()));
}

TEST(Ply, DamagedFilesGiveErrorsOnly) {
  const test::TemporaryFolder folder;
  const Mesh mesh = test::small_asset(3, 3).mesh;
  write_ply(folder / "mesh.ply", mesh);
  const auto read = [](const auto& path) { read_ply(path); };
  test::expect_errors_only(read_file(folder / "mesh.ply"), folder / "damaged.ply", read);
  test::expect_errors_only(ascii(kXyz, kRows, "3 0 1 2\n4 0 1 2 3\n"), folder / "damaged.ply", read);
}

}  // namespace
}  // namespace anigen::io
