#include "anigen/io/mtl.h"

#include <gtest/gtest.h>

#include "anigen/core/error.h"
#include "anigen/core/files.h"
#include "anigen/io/image.h"
#include "anigen/io/rigs/rig_reader.h"
#include "tests/support/paths.h"

namespace anigen::io {
namespace {

TEST(MtlText, MaterialsHaveColoursOpacitiesAndTextures) {
  const auto materials = parse_mtl(
      "# made by hand\nnewmtl  red paint \nKd 0.8 0.1 0.2\nd 0.5\n\nnewmtl wood\nKd 0.3\nTr 0.25\n"
      "map_Kd -blendu on -s 2 2 -o 0.5 my wood.png # a comment\nnewmtl lamp\nKd spectral a.rfl 1\nKs 1 1 1\nd 0\n",
      "a.mtl");
  ASSERT_EQ(materials.size(), 3u);
  EXPECT_EQ(materials[0].name, "red paint");
  EXPECT_TRUE(materials[0].color.isApprox(Eigen::Vector4f(0.8F, 0.1F, 0.2F, 0.5F)));
  EXPECT_EQ(materials[0].texture, "");
  EXPECT_TRUE(materials[1].color.isApprox(Eigen::Vector4f(0.3F, 0.3F, 0.3F, 0.75F)));
  EXPECT_EQ(materials[1].texture, "my wood.png");
  EXPECT_TRUE(materials[2].color.isApprox(Eigen::Vector4f::Ones())) << "an opacity of 0 does not count";
}

TEST(MtlText, ProblemsNameTheLine) {
  for (const auto& [text, line] :
       {std::pair{"Kd 1 1 1\n", "line 1"}, {"newmtl a\nKd 1 x 1\n", "line 2"}, {"newmtl a\n\nd nan\n", "line 3"}}) {
    try {
      parse_mtl(text, "b.mtl");
      ADD_FAILURE() << text;
    } catch (const InputError& error) {
      EXPECT_NE(std::string(error.what()).find(line), std::string::npos) << error.what();
    }
  }
}

class PaintedObj : public testing::Test {
 protected:
  void write(const std::string& name, const std::string& text) {
    std::filesystem::create_directories((folder_ / name).parent_path());
    write_file_atomically(folder_ / name, text);
  }
  // Two triangles and a square, of three materials.
  void write_obj(const std::string& head) {
    write("a.obj",
          head +
              "v 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\nvt 0 0\nvt 1 0\nvt 1 1\nvt 0 1\n"
              "f 1/1 2/2 3/3\nusemtl red\nf 1/1 3/3 4/4\nusemtl wood\nf 1/1 2/2 3/3 4/4\nusemtl red\nf 1 2 4\n");
  }
  PaintedMesh read() const { return read_painted_obj(folder_ / "a.obj"); }
  bool has_note(const PaintedMesh& painted, const std::string& text) const {
    for (const std::string& note : painted.notes) {
      if (note.find(text) != std::string::npos) return true;
    }
    return false;
  }
  test::TemporaryFolder folder_;
};

TEST_F(PaintedObj, FacesHaveTheirMaterialsAndTexturesOfTheLibrary) {
  write_obj("mtllib looks of a.mtl\n");
  write("looks of a.mtl", "newmtl red\nKd 0.9 0 0\nnewmtl wood\nKd 0.2 0.2 0.2\nmap_Kd C:\\art\\grain.png\n");
  write_png(folder_ / "textures/grain.png", Image(2, 2, 0x336699FF));
  const PaintedMesh painted = read();
  EXPECT_EQ(painted.notes, std::vector<std::string>());
  EXPECT_EQ(painted.mesh.face_materials, (std::vector<std::int32_t>{-1, 0, 1, 1, 0}));
  ASSERT_EQ(painted.materials.size(), 2u);
  EXPECT_TRUE(painted.materials[0].base_color.isApprox(Eigen::Vector4f(0.9F, 0, 0, 1)));
  EXPECT_EQ(painted.materials[0].image, -1);
  EXPECT_EQ(painted.materials[1].name, "wood");
  EXPECT_EQ(painted.materials[1].image, 0);
  EXPECT_TRUE(painted.materials[1].base_color.isApprox(Eigen::Vector4f::Ones())) << "a texture replaces the colour";
  ASSERT_EQ(painted.images.size(), 1u);
  EXPECT_EQ(decode_image(painted.images[0].bytes, "").pixel(1, 1)[2], 0x99);

  // The rigger sees the same.
  const auto source = open_meshes(folder_ / "a.obj", {});
  const RiggedShape shape = source->read(source->ids().front());
  EXPECT_EQ(shape.materials.size(), 2u);
  EXPECT_EQ(shape.images.size(), 1u);
}

TEST_F(PaintedObj, WhatIsMissingIsNotedAndTheMeshIsRead) {
  write_obj("mtllib nowhere.mtl\n");
  PaintedMesh painted = read();
  EXPECT_EQ(painted.mesh.faces.size(), 5u);
  EXPECT_TRUE(has_note(painted, "nowhere.mtl"));
  EXPECT_TRUE(has_note(painted, "material wood is in no library"));
  EXPECT_TRUE(painted.materials[1].base_color.isApprox(Eigen::Vector4f::Ones()));

  write_obj("mtllib here.mtl\n");
  write("here.mtl", "newmtl red\nnewmtl wood\nKd 0.5 0.4 0.3\nmap_Kd no_picture.png\n");
  write("no_picture.png", "text");
  painted = read();
  EXPECT_TRUE(has_note(painted, "no_picture.png"));
  EXPECT_TRUE(painted.materials[1].base_color.isApprox(Eigen::Vector4f(0.5F, 0.4F, 0.3F, 1))) << "its colour instead";

  write("here.mtl", "newmtl red\nKd 1 2\nnewmtl wood\nKd broken\n");
  EXPECT_TRUE(has_note(read(), "line 4")) << "a broken library is as good as none";
}

TEST_F(PaintedObj, NothingOutsideTheFolderIsRead) {
  const std::filesystem::path secret = folder_ / "secret.png";
  write_png(secret, Image(2, 2, 0xFF0000FF));
  write("inner/a.obj", "mtllib m.mtl\nv 0 0 0\nv 1 0 0\nv 0 1 0\nusemtl m\nf 1 2 3\n");
  for (const std::string& named : {std::string("../secret.png"), secret.string()}) {
    write("inner/m.mtl", "newmtl m\nmap_Kd " + named + "\n");
    const PaintedMesh painted = read_painted_obj(folder_ / "inner/a.obj");
    EXPECT_TRUE(painted.images.empty()) << named;
    EXPECT_EQ(painted.notes.size(), 1u);
  }
}

}  // namespace
}  // namespace anigen::io
