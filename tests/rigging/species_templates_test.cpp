#include <gtest/gtest.h>

#include <string>
#include <vector>

#include "anigen/core/error.h"
#include "anigen/rigging/pinocchio.h"
#include "anigen/rigging/species_templates.h"
#include "tests/rigging/embedding_bodies.h"

namespace anigen::rigging {

namespace {

class SpeciesTemplates : public testing::TestWithParam<std::string> {};

// A body of capsules along the bones of the template, thicker where the template says that it is.
Mesh body_of(const TemplateSkeleton& skeleton) {
  std::vector<test::Capsule> capsules;
  for (const TemplateJoint& joint : skeleton.joints) {
    const auto parent = static_cast<std::size_t>(std::max(0, joint.parent));
    const TemplateJoint& above = skeleton.joints[parent];
    capsules.push_back({above.position, joint.position, joint.fat || above.fat ? 0.03 : 0.016});
  }
  return test::capsule_mesh(capsules, 10, 3);
}

TEST_P(SpeciesTemplates, AreSoundAndMirrored) {
  const TemplateSkeleton skeleton = species_template(GetParam());
  EXPECT_NO_THROW(check(skeleton));
  EXPECT_EQ(skeleton.name, GetParam());
  EXPECT_EQ(skeleton.box.maxCoeff(), 1.0);
  for (std::size_t j = 0; j < skeleton.joints.size(); ++j) {
    const TemplateJoint& joint = skeleton.joints[j];
    EXPECT_TRUE((joint.position.cwiseAbs().array() <= 0.5).all()) << joint.name;
    EXPECT_EQ(joint.mirror < 0, joint.position.x() == 0.0) << joint.name;
    if (joint.mirror < 0) continue;
    EXPECT_EQ(skeleton.joints[static_cast<std::size_t>(joint.mirror)].position.x(), -joint.position.x());
  }
}

TEST_P(SpeciesTemplates, FindThemselvesInABodyOfTheirs) {
  const TemplateSkeleton skeleton = species_template(GetParam());
  const EmbeddedSkeleton embedded = embed_skeleton(body_of(skeleton), skeleton);
  double sum = 0.0;
  std::size_t joints = 0;
  for (const TemplateJoint& joint : skeleton.joints) {
    if (joint.guide) continue;
    for (std::size_t j = 0; j < embedded.skeleton.size(); ++j) {
      if (embedded.skeleton.names[j] != joint.name) continue;
      // The body's own box is a little larger than the template's, by the radius of the capsules.
      sum += (embedded.skeleton.positions()[j] - joint.position).norm();
      ++joints;
    }
  }
  EXPECT_EQ(joints, embedded.skeleton.size());
  // Joints along a limb go to equal shares of it, and the refinement centres them: a few per cent of the box.
  EXPECT_LT(sum / static_cast<double>(joints), 0.05) << "penalty " << embedded.penalty;
}

INSTANTIATE_TEST_SUITE_P(All, SpeciesTemplates, testing::ValuesIn(template_words()),
                         [](const auto& info) { return info.param; });

TEST(SpeciesTemplate, AnUnknownWordIsRefused) {
  try {
    species_template("unicorn");
    FAIL();
  } catch (const InputError& error) {
    EXPECT_NE(std::string(error.what()).find("spider"), std::string::npos);
  }
}

}  // namespace
}  // namespace anigen::rigging
