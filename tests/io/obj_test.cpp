#include <gtest/gtest.h>
#include <fstream>
#include <string>

#include "anigen/core/config.h"
#include "anigen/core/error.h"
#include "anigen/core/files.h"
#include "anigen/io/obj.h"
#include "tests/io/file_fuzz.h"
#include "tests/io/small_asset.h"
#include "tests/support/paths.h"

namespace anigen::io {

namespace {

Mesh parsed(const std::string& text) {
  const test::TemporaryFolder folder;
  std::ofstream(folder / "mesh.obj", std::ios::binary) << text;
  return read_obj(folder / "mesh.obj");
}

// The message of the error that reading the text raises.
std::string complaint(const std::string& text) {
  try {
    parsed(text);
  } catch (const InputError& error) {
    return error.place() + ": " + error.problem();
  }
  return "no error";
}

const std::string kThree = "v 0 0 0\nv 1 0 0\nv 0 1 0\n";
const std::string kFour = kThree + "v 0 0 1\n";

TEST(Obj, ReadsTriangles) {
  const Mesh mesh =
      parsed("# a comment\no thing\ng part\nusemtl red\nmtllib a.mtl\ns off\n" + kThree + "f 1 2 3 # end\n");
  ASSERT_EQ(mesh.vertices.size(), 3u);
  EXPECT_EQ(mesh.vertices[1], Eigen::Vector3f(1, 0, 0));
  ASSERT_EQ(mesh.faces.size(), 1u);
  EXPECT_EQ(mesh.faces[0], (Triangle{0, 1, 2}));
  EXPECT_TRUE(mesh.uvs.empty() && mesh.normals.empty() && mesh.colors.empty());
}

TEST(Obj, ReadsCarriageReturnsTabsAndAMissingLastLineEnd) {
  const Mesh mesh = parsed("v 0 0 0\r\nv\t+1\t0 0 \r\nv 0 1e0 0\r\n\r\nf 1 2 3");
  ASSERT_EQ(mesh.faces.size(), 1u);
  EXPECT_EQ(mesh.vertices[1].x(), 1.0f);
}

TEST(Obj, SplitsPolygonsIntoFans) {
  const Mesh mesh = parsed(kFour + "v 2 2 2\nf 1 2 3 4\nf 5 4 3 2 1\n");
  const std::vector<Triangle> expected = {{0, 1, 2}, {0, 2, 3}, {4, 3, 2}, {4, 2, 1}, {4, 1, 0}};
  EXPECT_EQ(mesh.faces, expected);
}

TEST(Obj, NegativeIndicesCountBack) {
  const Mesh mesh = parsed(kThree + "vt 0 0\nvn 0 0 1\nf -3/-1/-1 -2/-1/-1 -1/-1/-1\nv 5 5 5\nf -4 -3 -1\n");
  EXPECT_EQ(mesh.faces[0], (Triangle{0, 1, 2}));
  EXPECT_EQ(mesh.vertices[static_cast<std::size_t>(mesh.faces[1][2])], Eigen::Vector3f(5, 5, 5));
}

TEST(Obj, ContinuesLinesAfterABackslash) {
  const Mesh mesh = parsed(kFour + "f 1 2 \\\n3 \\\r\n4\n# C:\\models\\\nf 2 3 4\n");
  EXPECT_EQ(mesh.faces.size(), 3u) << "a comment does not swallow the next line";
}

TEST(Obj, TurnsTextureCoordinatesUpsideDown) {
  const Mesh mesh = parsed(kThree + "vt 0.25 0.1\nvt 0.5 1 0\nvt 0.75\nf 1/1 2/2 3/3\n");
  EXPECT_EQ(mesh.uvs[0], Eigen::Vector2f(0.25f, 0.9f));
  EXPECT_EQ(mesh.uvs[1], Eigen::Vector2f(0.5f, 0.0f));
  EXPECT_EQ(mesh.uvs[2], Eigen::Vector2f(0.75f, 1.0f));
}

TEST(Obj, SplitsAVertexOnlyWhereSomethingDiffers) {
  // Vertex 1 has two texture coordinates; the normals are the same numbers under different indices.
  const Mesh mesh = parsed(kFour +
                           "vt 0 0\nvt 1 1\nvn 0 0 1\nvn 0 0 2\nvn 0 0 1\n"
                           "f 1/1/1 2/1/1 3/1/1\nf 1/2/3 3/1/3 4/1/3\n");
  ASSERT_EQ(mesh.vertices.size(), 5u);
  EXPECT_EQ(mesh.faces[0], (Triangle{0, 1, 2}));
  EXPECT_EQ(mesh.faces[1], (Triangle{4, 2, 3}));
  EXPECT_EQ(mesh.vertices[4], mesh.vertices[0]);
  EXPECT_EQ(mesh.uvs[4], Eigen::Vector2f(1, 0));
  EXPECT_EQ(mesh.uvs[0], Eigen::Vector2f(0, 1));
  EXPECT_EQ(mesh.normals.size(), 5u);
}

TEST(Obj, NormalsHaveUnitLengthAndMissingOnesAreComputed) {
  const Mesh mesh = parsed(kFour + "vn 0 3 4\nvn 0 0 0\nf 1//1 2//2 3\nf 1//1 3 4\n");
  EXPECT_LT((mesh.normals[0] - Eigen::Vector3f(0, 0.6f, 0.8f)).norm(), 1e-6f);
  for (const Eigen::Vector3f& normal : mesh.normals) EXPECT_NEAR(normal.norm(), 1.0f, 1e-6f);
}

TEST(Obj, ReadsVertexColours) {
  const Mesh mesh = parsed("v 0 0 0 1 0.5 0\nv 1 0 0\nv 0 1 0 0 0 2 0.5\nv 0 0 1 1\nf 1 2 3\n");
  ASSERT_EQ(mesh.colors.size(), 4u);
  EXPECT_EQ(mesh.colors[0], Eigen::Vector4f(1, 0.5f, 0, 1));
  EXPECT_EQ(mesh.colors[1], Eigen::Vector4f::Ones());
  EXPECT_EQ(mesh.colors[2], Eigen::Vector4f(0, 0, 1, 0.5f));
  EXPECT_EQ(mesh.colors[3], Eigen::Vector4f::Ones()) << "a fourth coordinate is no colour";
}

TEST(Obj, KeepsVerticesThatNoFaceUses) { EXPECT_EQ(parsed(kFour + "f 1 2 3\n").vertices.size(), 4u); }

TEST(Obj, ErrorsNameTheLine) {
  EXPECT_EQ(complaint(kThree + "f 1 2 4\n"), "line 4: vertex 4 does not exist: the file has 3");
  EXPECT_EQ(complaint(kThree + "\nf 1 2 -4\n"), "line 5: index -4 reaches before the first of 3");
  EXPECT_EQ(complaint(kThree + "f 1 2\n"), "line 4: a face needs at least 3 corners, found 2");
  EXPECT_EQ(complaint(kThree + "f\n"), "line 4: a face needs at least 3 corners, found 0");
  EXPECT_EQ(complaint(kThree + "f 0 1 2\n"), "line 4: index 0: indices count from 1");
  EXPECT_EQ(complaint(kThree + "f 1 \\\n2 \\\n9\n"), "line 4: vertex 9 does not exist: the file has 3");
  EXPECT_EQ(complaint("v 0 0\n"), "line 1: expected 3 numbers, found 2");
  EXPECT_EQ(complaint("v 0 0 nan\n"), "line 1: a number is not finite");
  EXPECT_EQ(complaint("v 0 0 1e60\n"), "line 1: a number is not finite");
  EXPECT_EQ(complaint("v 0 0 zero\n"), "line 1: 'zero' is not a number");
  EXPECT_EQ(complaint("v 1 2 3 4 5\n").substr(0, 7), "line 1:");
  EXPECT_EQ(complaint("v 1 2 3 4 5 6 7 8\n"), "line 1: more than 7 numbers");
  EXPECT_EQ(complaint(kThree + "vt 0 0\nf 1/1 2/2 3/1\n"),
            "line 5: texture coordinate 2 does not exist: the file has 1");
  EXPECT_EQ(complaint(kThree + "f 1//1 2//1 3//1\n"), "line 4: normal 1 does not exist: the file has 0");
  for (const char* corner : {"1/1/1/1", "/1", "1.5", "x", "99999999999999999999", "1e400", "//"}) {
    EXPECT_EQ(complaint(kThree + "f 1 2 " + corner + "\n").substr(0, 7), "line 4:") << corner;
  }
  EXPECT_EQ(complaint(""), ": no vertices: not an OBJ file, or an empty one");
}

TEST(Obj, MissingFileIsAnInputError) { EXPECT_THROW(read_obj("/nonexistent/mesh.obj"), InputError); }

TEST(Obj, RoundTripIsExact) {
  Mesh mesh = test::small_asset(3, 7).mesh;
  mesh.face_materials.clear();  // not part of the format
  mesh.colors[3].w() = 0.25f;
  mesh.vertices[2] = {1.0f / 3.0f, -1e-30f, 1e20f};
  const test::TemporaryFolder folder;
  write_obj(folder / "mesh.obj", mesh);
  const Mesh again = read_obj(folder / "mesh.obj");
  EXPECT_EQ(again.vertices, mesh.vertices);
  EXPECT_EQ(again.faces, mesh.faces);
  EXPECT_EQ(again.uvs, mesh.uvs);
  EXPECT_EQ(again.colors, mesh.colors);
  ASSERT_EQ(again.normals.size(), mesh.normals.size());
  // Reading divides by the length, which is 1 but for rounding.
  for (std::size_t v = 0; v < mesh.normals.size(); ++v) EXPECT_LT((again.normals[v] - mesh.normals[v]).norm(), 2e-7f);
}

TEST(Obj, RoundTripOfPositionsAlone) {
  Mesh mesh;
  mesh.vertices = {{0, 0, 0}, {1, 0, 0}, {0, 1, 0}};
  mesh.faces = {{2, 1, 0}};
  const test::TemporaryFolder folder;
  write_obj(folder / "mesh.obj", mesh);
  const Mesh again = read_obj(folder / "mesh.obj");
  EXPECT_EQ(again.vertices, mesh.vertices);
  EXPECT_EQ(again.faces, mesh.faces);
  EXPECT_TRUE(again.uvs.empty() && again.normals.empty() && again.colors.empty());
}

TEST(Obj, RefusesToWriteAnUnsoundMesh) {
  const test::TemporaryFolder folder;
  Mesh mesh = test::small_asset().mesh;
  mesh.faces[0][1] = 99;
  EXPECT_THROW(write_obj(folder / "mesh.obj", mesh), InputError);
  mesh = test::small_asset().mesh;
  mesh.uvs.pop_back();
  EXPECT_THROW(write_obj(folder / "mesh.obj", mesh), InputError);
  EXPECT_THROW(write_obj(folder / "mesh.obj", Mesh()), InputError);
  EXPECT_TRUE(std::filesystem::is_empty(folder.path()));
}

TEST(Obj, DamagedFilesGiveErrorsOnly) {
  const test::TemporaryFolder folder;
  write_obj(folder / "mesh.obj", test::small_asset(3, 3).mesh);
  const std::string bytes = read_file(folder / "mesh.obj");
  test::expect_errors_only(bytes, folder / "damaged.obj", [](const auto& path) { read_obj(path); });
}

}  // namespace

namespace {

TEST(ObjRig, MeshAndRigInTheAxesOfTheFile) {
  const test::TemporaryFolder folder;
  const Asset asset = test::small_asset();
  write_obj_rig(folder / "a.obj", asset);
  const Mesh mesh = read_obj(folder / "a.obj");
  const Json rig = read_json(folder / "a.rig.json");
  ASSERT_EQ(mesh.vertices.size(), asset.mesh.vertices.size());
  const auto turned = [](const auto& p) { return std::array<double, 3>{p.x(), p.z(), -p.y()}; };  // Z up → Y up
  for (std::size_t v = 0; v < mesh.vertices.size(); ++v) {
    const auto expected = turned(asset.mesh.vertices[v]);
    for (int c = 0; c < 3; ++c) EXPECT_NEAR(mesh.vertices[v][c], expected[static_cast<std::size_t>(c)], 1e-6);
  }
  const auto positions = asset.skeleton.positions();
  ASSERT_EQ(rig["joints"].size(), positions.size());
  for (std::size_t j = 0; j < positions.size(); ++j) {
    EXPECT_EQ(rig["joints"][j]["name"], asset.skeleton.names[j]);
    EXPECT_EQ(rig["joints"][j]["parent"], asset.skeleton.parents[j]);
    for (std::size_t c = 0; c < 3; ++c)
      EXPECT_NEAR(rig["joints"][j]["position"][c].get<double>(), turned(positions[j])[c], 1e-9);
  }
  ASSERT_EQ(rig["skin"].size(), asset.mesh.vertices.size());
  EXPECT_EQ(rig["skin"][0][0][0], asset.skin.row(0)[0].joint);
  EXPECT_FLOAT_EQ(rig["skin"][0][0][1].get<float>(), asset.skin.row(0)[0].weight);
}

TEST(ObjRig, RefusesAMeshWithoutWeights) {
  const test::TemporaryFolder folder;
  Asset asset = test::small_asset();
  asset.skin = {};
  EXPECT_THROW(write_obj_rig(folder / "a.obj", asset), InputError);
  EXPECT_FALSE(std::filesystem::exists(folder / "a.obj"));
}

}  // namespace

}  // namespace anigen::io
