#include "anigen/io/stl.h"

#include <gtest/gtest.h>

#include <cstring>
#include <fstream>
#include <limits>
#include <string>
#include <vector>

#include "anigen/core/error.h"
#include "tests/io/file_fuzz.h"
#include "tests/support/paths.h"
#include "tests/support/rig_files.h"

namespace anigen::io {
namespace {

Mesh parsed_stl(const std::string& bytes) {
  const test::TemporaryFolder folder;
  std::ofstream(folder / "mesh.stl", std::ios::binary) << bytes;
  return read_stl(folder / "mesh.stl");
}

std::string stl_complaint(const std::string& bytes) {
  return test::refusal([&] { parsed_stl(bytes); });
}

template <typename T>
std::string stored(T value) {  // the tests run on little-endian machines
  std::string bytes(sizeof(T), '\0');
  std::memcpy(bytes.data(), &value, sizeof(T));
  return bytes;
}

/// @param places three corners of three coordinates per triangle
std::string binary(const std::vector<float>& places, const std::string& header = "made by hand") {
  std::string bytes = header + std::string(80 - header.size(), '\0');
  bytes += stored(static_cast<std::uint32_t>(places.size() / 9));
  for (std::size_t i = 0; i < places.size(); ++i) {
    if (i % 9 == 0) bytes += std::string(12, '\0');  // a normal of nothing
    bytes += stored(places[i]);
    if (i % 9 == 8) bytes += std::string(2, '\0');
  }
  return bytes;
}

/// Two triangles of a square, with its middle diagonal twice.
const std::vector<float> kSquare = {0, 0, 0, 1, 0, 0, 1, 1, 0, 0, 0, 0, 1, 1, 0, 0, 1, 0};
const char* const kText =
    "solid a name with facet and vertex in it\n"
    " facet normal 0 0 1\n  outer loop\n   vertex 0 0 0\n   vertex 1 0 0\n   vertex 1 1e0 0\n  endloop\n endfacet\n"
    " FACET NORMAL 0 0 1\r\n  OUTER LOOP\r\n   VERTEX -0 0 0\r\n   vertex 1 1 0\n   vertex 0 1 0\n  endloop\n "
    "endfacet\n"
    "endsolid a name\n";

void expect_square(const Mesh& mesh) {
  ASSERT_EQ(mesh.vertices.size(), 4u) << "corners in one place are one vertex";
  EXPECT_EQ(mesh.vertices[2], Eigen::Vector3f(1, 1, 0));
  EXPECT_EQ(mesh.faces, (std::vector<Triangle>{{0, 1, 2}, {0, 2, 3}}));
}

TEST(Stl, ReadsBinaryAndText) {
  expect_square(parsed_stl(binary(kSquare)));
  expect_square(parsed_stl(kText));
  expect_square(parsed_stl(binary(kSquare, "solid by a program that calls its binary files so")));
  expect_square(parsed_stl(binary(kSquare) + "a tail that nothing tells of"));
}

TEST(Stl, SeveralSolidsAreOneMesh) {
  const std::string first = kText;
  std::string second = kText;
  for (std::size_t at = 0; (at = second.find("vertex 0", at)) != std::string::npos; at += 8) second[at + 7] = '9';
  const Mesh mesh = parsed_stl(first + "solid\nendsolid\n" + second);
  EXPECT_EQ(mesh.faces.size(), 4u);
}

TEST(Stl, TrianglesWithoutAreaOfTheirOwnAreLeftOut) {
  std::vector<float> places = kSquare;
  places.insert(places.end(), {5, 5, 5, 5, 5, 5, 6, 6, 6});
  EXPECT_EQ(parsed_stl(binary(places)).faces.size(), 2u);
  EXPECT_EQ(stl_complaint(binary({5, 5, 5, 5, 5, 5, 6, 6, 6})),
            "every triangle names a place twice: there is no surface");
}

TEST(Stl, DamagedFilesAreErrors) {
  const test::TemporaryFolder folder;
  for (const std::string& bytes : {binary(kSquare), std::string(kText)})
    test::expect_errors_only(bytes, folder / "a.stl", [](const std::filesystem::path& file) { read_stl(file); });
}

TEST(Stl, RefusesByPlace) {
  EXPECT_EQ(stl_complaint("solid x\nendsolid x\n"), "no triangles");
  EXPECT_EQ(stl_complaint("short"), "byte 5: the header is cut short");
  EXPECT_EQ(stl_complaint(binary(kSquare).substr(0, 150)),
            "byte 150: the file ends before the 2 triangles that it announces: cut short, or no STL file");
  std::vector<float> places = kSquare;
  places[5] = std::numeric_limits<float>::quiet_NaN();
  EXPECT_EQ(stl_complaint(binary(places)), "byte 108: a vertex is not finite");
  const std::string facet = "solid x\nfacet normal 0 0 1\nouter loop\n";
  EXPECT_EQ(stl_complaint(facet + "vertex 1 2\n"), "line 4: \"\" is not a finite number");
  EXPECT_EQ(stl_complaint(facet + "vertex 1 2 1e99\n"), "line 4: \"1e99\" is not a finite number");
  EXPECT_EQ(stl_complaint(facet + "vertex 1 2 3\nendloop\nendfacet\n"), "line 6: a facet has 1 vertices in place of 3");
  EXPECT_EQ(stl_complaint(facet + "facet normal 0 0 1\n"), "line 4: a facet begins inside another one");
  EXPECT_EQ(stl_complaint(facet + "vertex 1 2 3\n"), "line 4: the file ends inside a facet");
  EXPECT_EQ(stl_complaint("solid x\nvertex 1 2 3\n"), "line 2: a vertex stands outside a facet of three");
  EXPECT_EQ(stl_complaint("solid x\nsphere 1\n"),
            "line 2: \"sphere\" is none of solid, facet, outer loop, vertex, endloop, endfacet, endsolid");
}

TEST(Stl, WritesWhatItReads) {
  const Mesh mesh = parsed_stl(binary(kSquare));
  const test::TemporaryFolder folder;
  write_stl(folder / "square.stl", mesh);
  expect_square(read_stl(folder / "square.stl"));
  EXPECT_EQ(std::filesystem::file_size(folder / "square.stl"), 84u + 2 * 50u);
  Mesh broken = mesh;
  broken.faces.clear();
  EXPECT_THROW(write_stl(folder / "none.stl", broken), InputError);
  broken.faces = {{0, 1, 9}};
  EXPECT_THROW(write_stl(folder / "none.stl", broken), InputError);
  EXPECT_FALSE(std::filesystem::exists(folder / "none.stl"));
}

}  // namespace
}  // namespace anigen::io
