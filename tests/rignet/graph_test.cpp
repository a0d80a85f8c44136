#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <functional>
#include <string>
#include <vector>

#include "anigen/core/error.h"
#include "anigen/rignet/graph.h"
#include "tests/rignet/rignet_small.h"

namespace anigen::rignet {
namespace {

// Largest difference between the gradient of Σ weights · f and its central differences.
double gradient_error(const std::function<Tensor(const Tensor&)>& f, const Tensor& at) {
  const Tensor x = at.clone().requires_grad_(true);
  const Tensor weights = torch::randn_like(f(at));
  (f(x) * weights).sum().backward();
  constexpr double kStep = 1e-6;
  double worst = 0.0;
  for (std::int64_t i = 0; i < at.numel(); ++i) {
    Tensor above = at.clone(), below = at.clone();
    above.flatten()[i] += kStep;
    below.flatten()[i] -= kStep;
    const double slope = ((f(above) - f(below)) * weights).sum().item<double>() / (2.0 * kStep);
    worst = std::max(worst, std::abs(slope - x.grad().flatten()[i].item<double>()));
  }
  return worst;
}

TEST(RignetEdges, SumsAndMaximaHaveTheGradientsOfDifferences) {
  torch::manual_seed(1);
  const EdgeSet edges = random_edges(7, 4);
  const Tensor a = torch::randn({7, 3}, torch::kFloat64), b = torch::randn({7, 3}, torch::kFloat64);
  EXPECT_LT(gradient_error([&](const Tensor& x) { return edge_sums(x, b, edges); }, a), 1e-8);
  EXPECT_LT(gradient_error([&](const Tensor& x) { return edge_sums(a, x, edges); }, b), 1e-8);
  const Tensor rows = torch::randn({edges.size(), 3}, torch::kFloat64);
  EXPECT_LT(gradient_error([&](const Tensor& x) { return run_maxima(x, edges.offsets); }, rows), 1e-8);
}

TEST(RignetEdges, BothWaysToComputeThemAgree) {
  torch::manual_seed(2);
  const EdgeSet edges = random_edges(200, 6);
  const auto both = [&](bool by_hand) {
    torch::manual_seed(3);
    const Tensor a = torch::randn({200, 19}).requires_grad_(true), b = torch::randn({200, 19}).requires_grad_(true);
    const Tensor sums = by_hand ? edge_sums(a, b, edges) : indexed_edge_sums(a, b, edges);
    // A value of its own for every edge: equal maxima would share gradients in one of the two.
    const Tensor apart = sums + 1e-3 * torch::rand({edges.size(), 19});
    const Tensor maxima = by_hand ? run_maxima(apart, edges.offsets) : scattered_maxima(apart, edges.offsets);
    (maxima * torch::rand({200, 19})).sum().backward();
    return std::vector<Tensor>{maxima.detach(), a.grad(), b.grad()};
  };
  const std::vector<Tensor> ours = both(true), theirs = both(false);
  for (std::size_t i = 0; i < ours.size(); ++i) EXPECT_LT(difference(ours[i], theirs[i]), 1e-5) << i;
}

TEST(RignetEdges, MaximaPassOnWhatIsNotANumber) {
  const Tensor values = torch::tensor({{1.0F}, {std::nanf("")}, {3.0F}, {2.0F}});
  const Tensor maxima = run_maxima(values, starts_of({3, 1}));
  EXPECT_TRUE(std::isnan(maxima[0][0].item<float>()));
  EXPECT_EQ(maxima[1][0].item<float>(), 2.0F);
}

TEST(RignetEdges, BadEdgesAreRefused) {
  const Tensor x = torch::zeros({2, 3});
  EXPECT_THROW(edge_sums(x, x, {starts_of({1, 1}), torch::tensor({0, 2}, torch::kInt64)}), InputError);
  EXPECT_THROW(run_maxima(x, starts_of({2, 0})), InputError);
  EXPECT_THROW(run_maxima(x, starts_of({1})), InputError);
}

// EdgeMessage as the reference writes it: an MLP of [x_i, x_j − x_i] per edge, the maximum per vertex.
Tensor slow_messages(EdgeMessage& message, const Tensor& x, const EdgeSet& edges) {
  const auto parameters = message->named_parameters();
  std::vector<Tensor> inputs;
  for (std::int64_t i = 0; i < edges.targets(); ++i) {
    const auto first = edges.offsets[i].item<std::int64_t>(), last = edges.offsets[i + 1].item<std::int64_t>();
    for (std::int64_t e = first; e < last; ++e) {
      const Tensor other = x[edges.sources[e].item<std::int64_t>()];
      inputs.push_back(torch::cat({x[i], other - x[i]}));
    }
  }
  // Batch statistics over all edges, as while training.
  const auto layer = [&](const Tensor& rows, const std::string& linear, const std::string& norm) {
    const Tensor y = torch::relu(torch::linear(rows, parameters[linear + ".weight"], parameters[linear + ".bias"]));
    const Tensor centred = y - y.mean(0), spread = (centred.square().mean(0) + 1e-5).sqrt();
    return centred / spread * parameters[norm + ".weight"] + parameters[norm + ".bias"];
  };
  const Tensor messages = layer(layer(torch::stack(inputs), "first", "norm"), "second.linear", "second.norm");
  std::vector<Tensor> maxima;
  for (std::int64_t i = 0; i < edges.targets(); ++i) {
    const auto first = edges.offsets[i].item<std::int64_t>(), last = edges.offsets[i + 1].item<std::int64_t>();
    maxima.push_back(messages.slice(0, first, last).amax(0));
  }
  return torch::stack(maxima);
}

TEST(RignetGraphUnit, MessagesAreThoseOfALoopOverEdges) {
  torch::manual_seed(4);
  EdgeMessage message(5, 6);
  for (Tensor& parameter : message->parameters()) torch::nn::init::uniform_(parameter, -0.7, 0.7);
  message->to(torch::kFloat64);
  const Tensor x = torch::randn({12, 5}, torch::kFloat64);
  const EdgeSet edges = random_edges(12, 5);
  EXPECT_LT(difference(message(x, edges), slow_messages(message, x, edges)), 1e-9);
}

TEST(RignetGraphUnit, ABatchOfMeshesIsThatOfEach) {
  torch::manual_seed(5);
  GraphUnit unit(3, 8);
  for (Tensor& parameter : unit->parameters()) torch::nn::init::uniform_(parameter, -0.7, 0.7);
  unit->eval();
  const MeshGraph a = random_graph(9), b = random_graph(14), c = random_graph(4);
  const Tensor together = unit(joined({a, b, c}).vertices, joined({a, b, c}));
  const Tensor apart = torch::cat({unit(a.vertices, a), unit(b.vertices, b), unit(c.vertices, c)});
  EXPECT_LT(difference(together, apart), 1e-6);
  EXPECT_EQ(joined({a, b, c}).starts[2].item<std::int64_t>(), 23);
  EXPECT_THROW(GraphUnit(3, 7), InputError);
}

}  // namespace
}  // namespace anigen::rignet
