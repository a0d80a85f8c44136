#include "anigen/eval/protocol.h"

#include <gtest/gtest.h>

#include <cmath>

#include "anigen/core/error.h"
#include "anigen/eval/metric_table.h"
#include "tests/rigging/binding_shapes.h"

namespace anigen::eval {
namespace {

using Points = std::vector<Eigen::Vector3d>;

/// A box of 2 × 1 × 1 with a chain of joints, every vertex on the first one.
io::RiggedShape boxed_chain(const Points& joints) {
  io::RiggedShape shape("chain", "chain.glb");
  test::append_box(shape.mesh, {0, 0, 0}, {2, 1, 1}, 4);
  shape.joints.positions = joints;
  for (std::size_t j = 0; j < joints.size(); ++j) shape.joints.parents.push_back(static_cast<int>(j) - 1);
  for (std::size_t v = 0; v < shape.mesh.vertices.size(); ++v) shape.skin.append_row({{0, 1.0F}});
  return shape;
}

void move_by(io::RiggedShape& shape, const Eigen::Vector3d& shift) {
  for (Eigen::Vector3f& vertex : shape.mesh.vertices) vertex += shift.cast<float>();
  for (Eigen::Vector3d& joint : shape.joints.positions) joint += shift;
}

PairResult scored(const std::string& word, const io::RiggedShape& predicted, const io::RiggedShape& truth) {
  PairSettings settings;
  settings.surface_samples = 500;
  settings.image_size = 16;
  settings.poses = 1;
  apply(evaluation_protocol(word), settings);
  settings.groups.erase("image");
  return evaluate_pair(predicted, truth, settings);
}

const Points kTrue{{0.5, 0.5, 0.5}, {1.5, 0.5, 0.5}}, kPredicted{{0.5, 0.5, 0.9}, {1.5, 0.5, 0.5}};

// The longest side is 2, so 0.4 are 0.2 of the frame; each direction has the distances 0.2 and 0.
TEST(Protocols, JointDistancesAreInTheUnitOfEach) {
  const io::RiggedShape truth = boxed_chain(kTrue), predicted = boxed_chain(kPredicted);
  EXPECT_NEAR(scored("rignet", predicted, truth).value("rignet.j2j"), 0.1, 1e-6);
  EXPECT_NEAR(scored("unirig", predicted, truth).value("unirig.j2j"), 0.1, 1e-6);
  EXPECT_NEAR(scored("anymate", predicted, truth).value("anymate_cd"), 0.2, 1e-6) << "its box has a side of 2";
  for (const char* word : {"magicarticulate", "puppeteer"})
    EXPECT_NEAR(scored(word, predicted, truth).value("puppeteer.j2j"), 0.1, 2e-4) << "joints in half precision";
  const Table table = protocol_table(
      [&] {
        Comparison comparison;
        comparison.methods = {"ours"};
        comparison.ids = {"chain", "lost"};
        comparison.results = {{scored("magicarticulate", predicted, truth), {}}};
        comparison.results[0][1].failure = "is not there";
        return comparison;
      }(),
      evaluation_protocol("magicarticulate"));
  EXPECT_EQ(table.columns[3], "CD-J2J ×10⁻² ↓");
  EXPECT_EQ(table.rows[0][2], "1");
  EXPECT_NEAR(std::stod(table.rows[0][3]), 10.0, 0.02);
  EXPECT_NE(table.rows[0][3].find("(1)"), std::string::npos) << "over the one asset that has a number";
}

// A prediction that lies elsewhere is wrong where the mesh is given, and registered where it is generated.
TEST(Protocols, OnlyAnigenRegisters) {
  const io::RiggedShape truth = boxed_chain(kTrue);
  io::RiggedShape predicted = boxed_chain(kTrue);
  move_by(predicted, {0.4, 0, 0});
  EXPECT_NEAR(scored("rignet", predicted, truth).value("rignet.j2j"), 0.2, 1e-6);
  EXPECT_NEAR(scored("unirig", predicted, truth).value("unirig.j2j"), 0.2, 1e-6);
  EXPECT_NEAR(scored("anigen", predicted, truth).value("j2j"), 0.0, 1e-3);
}

// With a joint at x = 4 the box of vertices and joints has a side of 4: UniRig's unit is that.
TEST(Protocols, UniRigsBoxHoldsTheJoints) {
  const io::RiggedShape truth = boxed_chain({{0.5, 0.5, 0.5}, {4.0, 0.5, 0.5}});
  const io::RiggedShape predicted = boxed_chain({{0.5, 0.5, 0.9}, {4.0, 0.5, 0.5}});
  EXPECT_NEAR(scored("unirig", predicted, truth).value("unirig.j2j"), 0.05, 1e-6);
  EXPECT_NEAR(scored("rignet", predicted, truth).value("rignet.j2j"), 0.1, 1e-6);
  // MagicArticulate's truth is clipped to the mesh's box, at 0.5 of the frame. From the prediction 0.2 and 1; from the
  // truth 0.2 and, since the first predicted joint is nearer to the clipped one than the second, √(0.75² + 0.2²).
  EXPECT_NEAR(scored("magicarticulate", predicted, truth).value("puppeteer.j2j"),
              0.5 * (0.5 * (0.2 + 1.0) + 0.5 * (0.2 + std::hypot(0.75, 0.2))), 1e-3);
}

// RigNet and Puppeteer sample bones every 0.005 with both ends; UniRig 100 times from the child on, without the
// parent's end.
TEST(Protocols, BonesAreSampledAsEachDoes) {
  const io::RiggedShape truth = boxed_chain(kTrue);
  const io::RiggedShape predicted = boxed_chain({{0.5, 0.5, 0.5}});
  // No bone: the joint stands for it. 101 samples 0, 0.005, …, 0.5 from it; back the joint is a sample itself.
  EXPECT_NEAR(scored("rignet", predicted, truth).value("rignet.b2b"), 0.5 * 0.25, 1e-6);
  // 100 samples at 0.5 · (1 − i / 100), i = 0 … 99: mean 0.2525; back the nearest sample is at 0.005.
  EXPECT_NEAR(scored("unirig", predicted, truth).value("unirig.b2b"), 0.5 * (0.2525 + 0.005), 1e-6);
}

TEST(Protocols, WeightsAreThresholdedAsEachDoes) {
  const io::RiggedShape truth = boxed_chain(kTrue);
  io::RiggedShape predicted = boxed_chain(kTrue);
  predicted.skin = {};
  for (std::size_t v = 0; v < predicted.mesh.vertices.size(); ++v) predicted.skin.append_row({{0, 0.9F}, {1, 0.1F}});
  const PairResult puppeteer = scored("puppeteer", predicted, truth);
  // 0.1 is below 0.15 of the largest weight and goes.
  EXPECT_NEAR(puppeteer.value("puppeteer.skin_precision"), 1.0, 1e-6);
  EXPECT_NEAR(puppeteer.value("puppeteer.skin_recall"), 1.0, 1e-6);
  EXPECT_NEAR(puppeteer.value("puppeteer.skin_l1"), 0.0, 1e-6);
  const PairResult rignet = scored("rignet", predicted, truth);
  EXPECT_NEAR(rignet.value("skin_precision"), 0.5, 1e-6) << "above 1e-4, and wrong";
  EXPECT_NEAR(rignet.value("skin_l1"), 0.2, 1e-6);
  EXPECT_NEAR(scored("unirig", predicted, truth).value("skin_mae"), 0.1, 1e-6) << "over joints, too";
  EXPECT_NEAR(scored("anymate", predicted, truth).value("skin_ce"), -std::log(0.9 + 1e-6), 1e-6);
}

// By hand: 0.6 and 0.4 are both kept (0.4 > 0.15 · 0.6); of two joints a vertex one is right, and |0.6 − 1| + 0.4 =
// 0.8.
TEST(Protocols, PuppeteersWeightsByHand) {
  const io::RiggedShape truth = boxed_chain(kTrue);
  io::RiggedShape predicted = boxed_chain(kTrue);
  predicted.skin = {};
  for (std::size_t v = 0; v < predicted.mesh.vertices.size(); ++v) predicted.skin.append_row({{0, 0.6F}, {1, 0.4F}});
  const PairResult result = scored("puppeteer", predicted, truth);
  EXPECT_NEAR(result.value("puppeteer.skin_precision"), 0.5, 1e-6);
  EXPECT_NEAR(result.value("puppeteer.skin_recall"), 1.0, 1e-6);
  EXPECT_NEAR(result.value("puppeteer.skin_l1"), 0.8, 1e-6);
}

// Rows are divided by their sums on reading, so that these look whole.
TEST(Protocols, PuppeteerLeavesOutVerticesWhoseTrueWeightsAreNotWhole) {
  io::RiggedShape truth = boxed_chain(kTrue);
  io::RiggedShape predicted = boxed_chain(kTrue);
  predicted.skin = {};
  std::vector<std::size_t> left, right;
  for (std::size_t v = 0; v < predicted.mesh.vertices.size(); ++v) {
    const bool is_left = predicted.mesh.vertices[v].x() < 1.05F;
    (is_left ? left : right).push_back(v);
    predicted.skin.append_row({{is_left ? 1 : 0, 1.0F}});  // the truth has joint 0 everywhere
  }
  const double whole = scored("puppeteer", predicted, truth).value("puppeteer.skin_l1");
  EXPECT_GT(whole, 0.5);
  truth.not_whole = left;
  EXPECT_NEAR(scored("puppeteer", predicted, truth).value("puppeteer.skin_l1"), 0.0, 1e-6);
  EXPECT_NEAR(scored("rignet", predicted, truth).value("skin_l1"), whole, 1e-6) << "of all vertices";
  truth.not_whole.insert(truth.not_whole.end(), right.begin(), right.end());
  EXPECT_EQ(scored("puppeteer", predicted, truth).not_computed.at("puppeteer.skin_l1"),
            "no vertex of the ground truth has weights that sum to 1");
}

TEST(Protocols, PuppeteerScoresNoWeightsOfMoreThan70Joints) {
  for (const std::size_t count : {70u, 71u}) {
    Points joints;
    for (std::size_t j = 0; j < count; ++j) joints.emplace_back(0.1 + 0.025 * static_cast<double>(j), 0.5, 0.5);
    const io::RiggedShape shape = boxed_chain(joints);
    const PairResult result = scored("puppeteer", shape, shape);
    EXPECT_NEAR(result.value("puppeteer.j2j"), 0.0, 1e-3) << "its skeletons have no such limit";
    if (count == 70u) {
      EXPECT_NEAR(result.value("puppeteer.skin_recall"), 1.0, 1e-6);
      continue;
    }
    for (const char* key : {"puppeteer.skin_precision", "puppeteer.skin_recall", "puppeteer.skin_l1"})
      EXPECT_EQ(result.not_computed.at(key),
                "Puppeteer scores no weights of more than 70 joints; the ground truth has 71");
    EXPECT_NEAR(result.value("skin_l1"), 0.0, 1e-6) << "other metrics have them";
  }
}

// The rig of a text file without a mesh: its rows of weights are for the vertices of the mesh that it was made for.
TEST(Protocols, ARigWithoutAMeshIsForTheGivenOne) {
  const io::RiggedShape truth = boxed_chain(kTrue);
  io::RiggedShape predicted = boxed_chain(kPredicted);
  predicted.mesh = {};
  const PairResult result = scored("puppeteer", predicted, truth);
  EXPECT_NEAR(result.value("puppeteer.j2j"), 0.1, 2e-4);
  EXPECT_NEAR(result.value("puppeteer.skin_recall"), 1.0, 1e-6);
  predicted.skin.append_row({{0, 1.0F}});
  const PairResult other = scored("puppeteer", predicted, truth);
  EXPECT_EQ(other.values.count("puppeteer.skin_recall"), 0u) << "weights of another mesh";
  EXPECT_EQ(other.not_computed.at("puppeteer.skin_recall"), "the prediction has no skin weights");
  EXPECT_NEAR(other.value("puppeteer.j2j"), 0.1, 2e-4);
}

TEST(Protocols, NameMetricsThatThereAre) {
  for (const EvaluationProtocol& protocol : evaluation_protocols()) {
    SCOPED_TRACE(protocol.word);
    EXPECT_EQ(&evaluation_protocol(protocol.word), &protocol);
    for (const ProtocolColumn& column : protocol.columns) EXPECT_NE(find_metric(column.key), nullptr) << column.key;
    PairSettings settings;
    apply(protocol, settings);
    EXPECT_NO_THROW(check(settings));
  }
  EXPECT_THROW(evaluation_protocol("skintokens"), NotSupportedError);
  try {
    evaluation_protocol("tailorrig");
    ADD_FAILURE() << "is not published";
  } catch (const NotSupportedError& error) {
    EXPECT_NE(std::string(error.what()).find("not supported: TailorRig's files, whose layout is not published"),
              std::string::npos)
        << error.what();
  }
  EXPECT_THROW(evaluation_protocol("other"), InputError);
}

}  // namespace
}  // namespace anigen::eval
