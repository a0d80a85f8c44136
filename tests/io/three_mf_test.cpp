#include "anigen/io/three_mf.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <fstream>
#include <string>

#include "anigen/core/error.h"
#include "anigen/core/files.h"
#include "anigen/io/arrays/npz.h"
#include "anigen/io/rigs/rig_reader.h"
#include "tests/io/file_fuzz.h"
#include "tests/support/paths.h"
#include "tests/support/rig_files.h"

namespace anigen::io {
namespace {

const std::string kTetrahedron =
    "<mesh><vertices><vertex x='0' y='0' z='0'/><vertex x='10' y='0' z='0'/><vertex x=\"0\" y=\"10\" z=\"0\" />"
    "<vertex x='0' y='0' z='1e1'/></vertices>\n<triangles><triangle v1='0' v2='2' v3='1'/><triangle v1='0' v2='1' "
    "v3='3'/>"
    "<triangle v1='1' v2='2' v3='3' pid='5'/><triangle v1='0' v2='3' v3='2'/></triangles></mesh>";

std::string model(const std::string& resources, const std::string& build, const std::string& unit = "") {
  return "<?xml version='1.0'?><!-- a > b --><model " + unit +
         " xmlns='http://schemas.microsoft.com/3dmanufacturing/core/2015/02'><resources>" + resources +
         "</resources><build>" + build + "</build></model>";
}

std::string solid(const std::string& id, const std::string& more = "") {
  return "<object id='" + id + "' " + more + ">" + kTetrahedron + "</object>";
}

class ThreeMf : public ::testing::Test {
 protected:
  std::filesystem::path write(const std::string& text, const std::string& name = "3D/3dmodel.model") {
    const std::filesystem::path file = folder_ / "part.3mf";
    write_zip(file, {{"[Content_Types].xml", "<Types/>"}, {name, text}});
    return file;
  }
  Mesh read(const std::string& text) { return read_three_mf(write(text)); }
  std::string complaint(const std::string& text) {
    return test::refusal([&] { read(text); });
  }

  test::TemporaryFolder folder_;
};

TEST_F(ThreeMf, PlacesWhatTheBuildNames) {
  const Mesh plain = read(model(solid("1") + solid("2"), "<item objectid='1'/>"));
  ASSERT_EQ(plain.vertices.size(), 4u) << "object 2 is not built";
  EXPECT_EQ(plain.faces.size(), 4u);
  EXPECT_NEAR(plain.vertices[1].x(), 0.01f, 1e-7f) << "millimetres are metres here";
  const Mesh inches =
      read(model(solid("1"), "<item objectid='1' transform='1 0 0 0 1 0 0 0 1 5 6 7'/>", "unit='inch'"));
  EXPECT_NEAR(inches.vertices[1].x(), 15 * 0.0254, 1e-6);
  EXPECT_NEAR(inches.vertices[0].z(), 7 * 0.0254, 1e-6);
}

TEST_F(ThreeMf, ComponentsAreNestedAndMirroredOnesFaceOutwards) {
  const std::string pair =
      "<object id='3'><components><component objectid='1'/>"
      "<component objectid='1' transform='-1 0 0 0 1 0 0 0 1 0 0 0'/></components></object>";
  const Mesh mesh =
      read(model(solid("1") + pair, "<item objectid='3' transform='0 1 0 -1 0 0 0 0 1 0 0 0'/>", "unit='meter'"));
  ASSERT_EQ(mesh.vertices.size(), 8u);
  EXPECT_EQ(mesh.vertices[1], Eigen::Vector3f(0, 10, 0)) << "rows of the matrix are images of the axes";
  EXPECT_EQ(mesh.vertices[5], Eigen::Vector3f(0, -10, 0));
  for (std::size_t part = 0; part < 2; ++part) {
    double volume = 0.0;
    for (std::size_t f = 4 * part; f < 4 * part + 4; ++f) {
      const auto corner = [&](std::size_t k) {
        return Eigen::Vector3d(mesh.vertices[static_cast<std::size_t>(mesh.faces[f][k])].cast<double>());
      };
      volume += corner(0).dot(corner(1).cross(corner(2))) / 6.0;
    }
    EXPECT_NEAR(volume, 1000.0 / 6.0, 1e-6) << part;
  }
}

TEST_F(ThreeMf, SupportsAreLeftOut) {
  EXPECT_EQ(
      read(model(solid("1") + solid("2", "type='support'"), "<item objectid='1'/><item objectid='2'/>")).faces.size(),
      4u);
}

TEST_F(ThreeMf, TheRelationshipsNameTheModel) {
  const std::filesystem::path file = folder_ / "part.3mf";
  write_zip(file, {{"_rels/.rels",
                    "<Relationships><Relationship Target='/thumb.png' Type='x/thumbnail'/><Relationship Id='r' "
                    "Target='/3D/own.model' Type='http://schemas.microsoft.com/3dmanufacturing/2013/01/3dmodel'/>"
                    "</Relationships>"},
                   {"3D/own.model", model(solid("1"), "<item objectid='1'/>")}});
  EXPECT_EQ(read_three_mf(file).faces.size(), 4u);
}

TEST_F(ThreeMf, AMeshSourceReadsIt) {
  const auto source = open_meshes(write(model(solid("1"), "<item objectid='1'/>", "unit='meter'")), {});
  ASSERT_EQ(source->ids().size(), 1u);
  EXPECT_EQ(source->read("part").mesh.vertices[3], Eigen::Vector3f(0, 0, 10)) << "Z is up";
}

TEST_F(ThreeMf, SaysWhatIsWrong) {
  const std::string one = "<item objectid='1'/>", text = model(solid("1"), one);
  EXPECT_NE(complaint(text.substr(0, text.find("10"))).find("cut short"), std::string::npos);
  EXPECT_NE(complaint(model(solid("1"), "")).find("names no object"), std::string::npos);
  EXPECT_NE(complaint(model(solid("1"), "<item objectid='7'/>")).find("object 7"), std::string::npos);
  EXPECT_NE(complaint(model("<object id='1'/>", one)).find("no triangle"), std::string::npos);
  std::string bad = text;
  bad.replace(bad.find("v3='1'"), 6, "v3='4'");
  EXPECT_NE(complaint(bad).find("vertex 4 of 4"), std::string::npos);
  bad = text;
  bad.replace(bad.find("1e1"), 3, "nan");
  EXPECT_NE(complaint(bad).find("vertex.z"), std::string::npos) << complaint(bad);
  EXPECT_NE(complaint(model(solid("1"), "<item objectid='1' transform='1 0 0'/>")).find("twelve"), std::string::npos);
  EXPECT_NE(complaint(model(solid("1"), one, "unit='furlong'")).find("furlong"), std::string::npos);
  EXPECT_NE(complaint("<!DOCTYPE x [<!ENTITY a 'b'>]>" + text).find("DOCTYPE"), std::string::npos);
  EXPECT_NE(complaint(model(solid("1"), "<item objectid='1' p:path='/3D/other.model'/>")).find("production"),
            std::string::npos);
  const std::string self =
      "<object id='1'><components><component objectid='1'/><component objectid='1'/></components></object>";
  EXPECT_NE(complaint(model(self, one)).find("object 1"), std::string::npos);
  EXPECT_NE(complaint(std::string("\xFF\xFE<\0m\0", 6)).find("UTF-16"), std::string::npos);
  EXPECT_NE(test::refusal([&] { read_three_mf(write(text, "3D/other.model")); }).find("there is no model"),
            std::string::npos);
  std::ofstream(folder_ / "text.3mf") << "no zip";
  EXPECT_NE(test::refusal([&] { read_three_mf(folder_ / "text.3mf"); }).find("zip"), std::string::npos);
  ThreeMfLimits limits;
  limits.max_faces = 3;
  EXPECT_NE(test::refusal([&] { read_three_mf(write(text), limits); }).find("limit"), std::string::npos);
}

TEST_F(ThreeMf, DamagedFilesAreErrors) {
  const std::filesystem::path file = write(model(solid("1"), "<item objectid='1'/>"));
  test::expect_errors_only(read_file(file), folder_ / "damaged.3mf",
                           [](const std::filesystem::path& path) { read_three_mf(path); });
}

}  // namespace
}  // namespace anigen::io
