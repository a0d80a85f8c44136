#include <gtest/gtest.h>

#include <cmath>
#include <set>

#include "anigen/core/error.h"
#include "anigen/train/distributed/same_parameters.h"
#include "anigen/train/distributed/single_process.h"
#include "tests/train/joined_ranks.h"

namespace anigen::train {
namespace {

using test::run_ranks;
using test::run_ranks_well;
using torch::Tensor;

// Values of one rank that no two ranks share.
Tensor values_of(int rank, std::int64_t count, torch::Dtype dtype = torch::kFloat32) {
  return (torch::arange(count, torch::kFloat64) * 0.37 + 100.0 * rank).sin().to(dtype);
}

TEST(Communicator, SumsGathersAndBroadcasts) {
  for (const int size : {2, 3}) {
    run_ranks_well(size, [&](Communicator& ranks) {
      EXPECT_EQ(ranks.size(), size);
      for (const torch::Dtype dtype : {torch::kFloat32, torch::kFloat64}) {
        Tensor expected = torch::zeros({1001}, dtype), sum = values_of(ranks.rank(), 1001, dtype);
        for (int rank = 0; rank < size; ++rank) expected += values_of(rank, 1001, dtype);
        ranks.start_sum(sum)->wait();
        EXPECT_TRUE(torch::allclose(sum, expected, 1e-6, 1e-6));
        EXPECT_NO_THROW(require_same_parameters(ranks, sum, "test")) << "the same bits on all ranks";
      }
      const std::vector<std::string> all = ranks.gather(std::string(static_cast<std::size_t>(ranks.rank()), 'x'));
      for (int rank = 0; rank < size; ++rank) {
        EXPECT_EQ(all[static_cast<std::size_t>(rank)].size(), static_cast<std::size_t>(rank));
      }
      Tensor from_first = torch::full({5}, static_cast<double>(ranks.rank()));
      ranks.broadcast(from_first);
      EXPECT_TRUE(torch::equal(from_first, torch::zeros({5})));
      ranks.barrier();
    });
  }
}

TEST(Communicator, SeveralSumsAreUnderWayAtOnce) {
  run_ranks_well(2, [](Communicator& ranks) {
    std::vector<Tensor> parts;
    std::vector<std::unique_ptr<PendingSum>> sums;
    for (int i = 0; i < 20; ++i) {
      parts.push_back(torch::full({100 + i}, static_cast<double>(i)));
      sums.push_back(ranks.start_sum(parts.back()));
    }
    for (int i = 20; i-- > 0;) {
      sums[static_cast<std::size_t>(i)]->wait();
      EXPECT_TRUE(torch::equal(parts[static_cast<std::size_t>(i)], torch::full({100 + i}, 2.0 * i)));
    }
  });
}

TEST(Communicator, RoundedSumsAreCloseAndTheSameEverywhere) {
  RankOptions options;
  options.sent = torch::kBFloat16;
  for (const int size : {2, 3}) {
    run_ranks_well(
        size,
        [&](Communicator& ranks) {
          Tensor expected = torch::zeros({1000}), sum = values_of(ranks.rank(), 1000);
          for (int rank = 0; rank < size; ++rank) expected += values_of(rank, 1000);
          ranks.start_sum(sum)->wait();
          EXPECT_TRUE(torch::allclose(sum, expected, 0.0, 0.01 * size)) << "bf16 has 8 bits";
          EXPECT_FALSE(torch::equal(sum, expected));
          EXPECT_NO_THROW(require_same_parameters(ranks, sum, "test"));
          Tensor exact = torch::full({2}, 1.0 + 1e-12, torch::kFloat64);
          ranks.start_sum(exact)->wait();
          EXPECT_TRUE(torch::equal(exact, torch::full({2}, size * (1.0 + 1e-12), torch::kFloat64))) << "never rounded";
          Tensor bad = torch::full({7}, ranks.rank() == 1 ? std::nan("") : 1.0);
          ranks.start_sum(bad)->wait();
          EXPECT_TRUE(torch::isnan(bad).all().item<bool>());
        },
        options);
  }
}

TEST(Communicator, DifferentParametersAreNamedOnEveryRank) {
  const auto errors = run_ranks(3, [](Communicator& ranks) {
    Tensor parameters = torch::ones({1000});
    require_same_parameters(ranks, parameters, "step 7");
    if (ranks.rank() == 1) parameters[500] = 1.0000001f;
    require_same_parameters(ranks, parameters, "step 8");
  });
  for (const std::exception_ptr& error : errors) {
    EXPECT_NE(test::message_of(error).find("step 8"), std::string::npos) << test::message_of(error);
    EXPECT_NE(test::message_of(error).find("of rank 1 differ"), std::string::npos) << test::message_of(error);
  }
}

TEST(Communicator, ARankThatGivesUpIsNamedWithItsReason) {
  RankOptions options;
  options.timeout = 20.0;
  const auto errors = run_ranks(
      3,
      [](Communicator& ranks) {
        ranks.barrier();
        if (ranks.rank() == 2) {
          ranks.leave("rank 2 stopped: the disk is full");
          return;
        }
        ranks.barrier();
      },
      options);
  for (const int rank : {0, 1}) {
    const std::string message = test::message_of(errors[static_cast<std::size_t>(rank)]);
    EXPECT_NE(message.find("the disk is full"), std::string::npos) << message;
    EXPECT_THROW(std::rethrow_exception(errors[static_cast<std::size_t>(rank)]), RankLost);
  }
}

TEST(Communicator, AUsedRendezvousIsRefused) {
  const test::TemporaryFolder folder;
  LaunchEnvironment environment;
  environment.size = 2;
  environment.launcher = "test";
  environment.rendezvous.file = (folder / "rendezvous").string();
  const auto join = [&](int rank) {
    environment.rank = rank;
    LaunchEnvironment own = environment;
    return std::thread([own] { join_ranks(own, {})->barrier(); });
  };
  std::thread first = join(0), second = join(1);
  first.join();
  second.join();
  environment.rank = 0;
  EXPECT_THROW(join_ranks(environment, {}), Error);
}

TEST(Communicator, OneProcessSendsNothing) {
  SingleProcess alone;
  Tensor values = torch::ones({3});
  alone.start_sum(values)->wait();
  alone.broadcast(values);
  EXPECT_TRUE(torch::equal(values, torch::ones({3})));
  EXPECT_EQ(alone.gather("a"), std::vector<std::string>{"a"});
  EXPECT_NO_THROW(require_same_parameters(alone, values, "test"));
  EXPECT_EQ(join_ranks({}, {})->size(), 1);
}

TEST(Checksum, SeesEveryBitAndTheOrder) {
  const Tensor values = torch::randn({1003});
  std::set<std::uint64_t> seen{checksum(values), checksum(values.flip(0)), checksum(values.slice(0, 0, 1002))};
  for (const int at : {0, 1, 7, 500, 1000, 1002}) {
    Tensor other = values.clone();
    other.data_ptr<float>()[at] = std::nextafter(other.data_ptr<float>()[at], 100.0f);
    seen.insert(checksum(other));
  }
  EXPECT_EQ(seen.size(), 9u);
  EXPECT_EQ(checksum(values), checksum(values.clone()));
}

}  // namespace
}  // namespace anigen::train
