#include "anigen/io/arrays/torch_archive.h"

#include <gtest/gtest.h>

#include <cmath>
#include <set>

#include "anigen/core/config.h"
#include "anigen/io/arrays/npz.h"
#include "anigen/io/arrays/safetensors.h"
#include "tests/io/arrays/array_file_bytes.h"

namespace anigen::io {
namespace {

using test::little;
using test::PickleBuilder;
using test::raw;

/// A tensor as torch.save pickles it.
void add_tensor(PickleBuilder& pickle, const std::string& type, const std::string& key, int storage_count, int offset,
                const std::vector<int>& shape, const std::vector<int>& stride, const std::string& device = "cuda:0") {
  pickle.global("torch._utils", "_rebuild_tensor_v2").mark().mark();
  pickle.text("storage").global("torch", type).text(key).text(device).integer(storage_count).tuple().op("Q");
  pickle.integer(offset);
  for (const auto* sizes : {&shape, &stride}) {
    pickle.mark();
    for (const int size : *sizes) pickle.integer(size);
    pickle.tuple();
  }
  pickle.boolean(false).global("collections", "OrderedDict").op(")").reduce().tuple().reduce();
}

class TorchArchive : public ::testing::Test {
 protected:
  std::filesystem::path archive(const std::string& pickle, const std::vector<ZipContent>& storages,
                                const std::string& folder = "any name") {
    std::vector<ZipContent> members = {{folder + "/data.pkl", pickle}};
    for (const ZipContent& storage : storages) members.push_back({folder + "/" + storage.name, storage.bytes});
    members.push_back({folder + "/version", "3\n"});
    write_zip(folder_ / "x.pt", members);
    return folder_ / "x.pt";
  }
  std::string problem(const std::string& pickle, const std::vector<ZipContent>& storages) {
    try {
      read_torch_archive(archive(pickle, storages));
    } catch (const InputError& error) {
      return error.what();
    }
    return "accepted";
  }
  const std::string six_ = little(0x3F800000, 4) + little(0x40000000, 4) + little(0x40400000, 4) +
                           little(0x40800000, 4) + little(0x40A00000, 4) + little(0x40C00000, 4);  // 1 to 6 as float32
  test::TemporaryFolder folder_;
};

TEST_F(TorchArchive, SharedStoragesStridesDtypesAndMetadata) {
  PickleBuilder pickle;
  pickle.global("collections", "OrderedDict").op(")").reduce().mark();
  pickle.text("flat.a");
  add_tensor(pickle, "FloatStorage", "0", 6, 0, {2, 2}, {2, 1});
  pickle.text("flat.b");
  add_tensor(pickle, "FloatStorage", "0", 6, 4, {2}, {1});
  pickle.text("transposed");
  add_tensor(pickle, "FloatStorage", "0", 6, 0, {2, 3}, {1, 2});
  pickle.text("half");
  add_tensor(pickle, "HalfStorage", "7", 1, 0, {}, {}, "cpu");
  pickle.text("bf16");
  add_tensor(pickle, "BFloat16Storage", "8", 1, 0, {1}, {1});
  pickle.text("empty");
  add_tensor(pickle, "LongStorage", "9", 0, 0, {0, 4}, {4, 1});
  pickle.text("parameter").global("torch._utils", "_rebuild_parameter").mark();
  add_tensor(pickle, "FloatStorage", "0", 6, 5, {1}, {1});
  pickle.boolean(true).global("collections", "OrderedDict").op(")").reduce().tuple().reduce();
  pickle.op("u}").mark().text("_metadata").op("}u").build();
  const NamedArrays state = read_torch_archive(archive(pickle.stop(), {{"byteorder", "little"},
                                                                       {"data/0", six_},
                                                                       {"data/7", raw("\0\x3c")},
                                                                       {"data/8", raw("\xf7\xc2")},
                                                                       {"data/9", ""}}));
  ASSERT_EQ(state.size(), 7u);
  EXPECT_EQ(state[0].first, "flat.a");
  EXPECT_EQ(state[0].second.as<float>(), (std::vector<float>{1, 2, 3, 4}));
  EXPECT_EQ(state[1].second.as<float>(), (std::vector<float>{5, 6}));
  EXPECT_EQ(state[2].second.shape, (std::vector<std::int64_t>{2, 3}));
  EXPECT_EQ(state[2].second.as<float>(), (std::vector<float>{1, 3, 5, 2, 4, 6}));
  EXPECT_EQ(state[3].second.dtype, Dtype::kF16);
  EXPECT_TRUE(state[3].second.shape.empty());
  EXPECT_EQ(state[4].second.as<float>(), std::vector<float>{-123.5f});
  EXPECT_EQ(state[5].second.shape, (std::vector<std::int64_t>{0, 4}));
  EXPECT_EQ(state[6].first, "parameter");
  EXPECT_EQ(state[6].second.as<float>(), std::vector<float>{6});
}  // namespace anigen::io

TEST_F(TorchArchive, BigEndianStorages) {
  PickleBuilder pickle;
  pickle.op("}").text("x");
  add_tensor(pickle, "IntStorage", "0", 2, 0, {2}, {1});
  const auto path = archive(pickle.op("s").stop(), {{"byteorder", "big"}, {"data/0", raw("\0\0\0\1\0\0\0\2")}});
  EXPECT_EQ(read_torch_archive(path)[0].second.as<std::int32_t>(), (std::vector<std::int32_t>{1, 2}));
}

TEST_F(TorchArchive, NestedObjectsBecomePaths) {
  PickleBuilder pickle;  // {'optimizer': {'state': {0: {'exp_avg': tensor}}, 'groups': [{'betas': (0.9, 0.99)}]},
                         // 'step': 7, 'name': 'x'}
  pickle.op("}").mark().text("optimizer").op("}").mark().text("state").op("}").integer(0).op("}").text("exp_avg");
  add_tensor(pickle, "FloatStorage", "0", 6, 1, {1}, {1});
  pickle.op("ss").text("groups").op("]}").text("betas").mark().real(0.9).real(0.99).tuple().op("sau");
  pickle.text("step").integer(7).text("name").text("x").text("amsgrad").boolean(true).text("grad_norm");
  pickle.begin_array({1}).dtype("f8").boolean(false).data(little(0x4000000000000000, 8)).end_array().op("u");
  const NamedArrays state = read_torch_archive(archive(pickle.stop(), {{"data/0", six_}}));
  EXPECT_EQ(find(state, "optimizer.state.0.exp_avg")->as<float>(), std::vector<float>{2});
  EXPECT_EQ(find(state, "optimizer.groups.0.betas.1")->as<double>(), std::vector<double>{0.99});
  EXPECT_EQ(find(state, "step")->as<std::int64_t>(), std::vector<std::int64_t>{7});
  EXPECT_EQ(find(state, "amsgrad")->dtype, Dtype::kBool);
  EXPECT_EQ(find(state, "grad_norm")->as<double>(), std::vector<double>{2});
  EXPECT_EQ(find(state, "name"), nullptr);
}

TEST_F(TorchArchive, CheckpointsGiveTheirWeightsAndTheirConfig) {
  PickleBuilder pickle;  // {'epoch': 3, 'state_dict': {'a.b': tensor}, 'optimizer': {'x': a storage that is not there},
                         // 'model_config': {'decoder': 'triplane', 'width': 8, 'sizes': [1, 0.5, None], 1: True}}
  pickle.op("}").mark().text("epoch").integer(3).text("state_dict").op("}").text("a.b");
  add_tensor(pickle, "FloatStorage", "0", 6, 1, {2}, {1});
  pickle.op("s").text("optimizer").op("}").text("x");
  add_tensor(pickle, "FloatStorage", "missing", 6, 1, {2}, {1});
  pickle.op("s").text("model_config").op("}").mark().text("decoder").text("triplane").text("width").integer(8);
  pickle.text("sizes").op("]").mark().integer(1).real(0.5).none().op("e").integer(1).boolean(true).op("uu");
  const auto path = archive(pickle.stop(), {{"data/0", six_}});
  const TorchCheckpoint checkpoint = read_torch_checkpoint(path, "model_config");
  ASSERT_EQ(checkpoint.state.size(), 1u);
  EXPECT_EQ(checkpoint.state[0].first, "a.b");
  EXPECT_EQ(checkpoint.state[0].second.as<float>(), (std::vector<float>{2, 3}));
  EXPECT_EQ(checkpoint.config,
            parse_json(R"({"decoder": "triplane", "width": 8, "sizes": [1, 0.5, null], "1": true})", "expected"));
  EXPECT_TRUE(read_torch_checkpoint(path, "absent").config.is_null());

  PickleBuilder plain;
  plain.op("}").text("weight");
  add_tensor(plain, "FloatStorage", "0", 6, 0, {1}, {1});
  const auto state = read_torch_checkpoint(archive(plain.op("s").stop(), {{"data/0", six_}}), "model_config").state;
  ASSERT_EQ(state.size(), 1u);
  EXPECT_EQ(state[0].first, "weight");

  PickleBuilder cyclic;  // {'state_dict': {}, 'model_config': l} with l = [l]
  cyclic.op("}").mark().text("state_dict").op("}").text("model_config").op("]").op("q\1").op("h\1").op("au");
  EXPECT_THROW(read_torch_checkpoint(archive(cyclic.stop(), {}), "model_config"), InputError);
}

// {'state_dict': {'model.part.weight': …, 'model.other': …}, 'optimizer': {'x': …}}: what is not asked for is not read,
// so that its storages need not even be there.
TEST_F(TorchArchive, APartOfALargeModel) {
  PickleBuilder pickle;
  pickle.op("}").mark().text("state_dict").op("}").mark().text("model.part.weight");
  add_tensor(pickle, "FloatStorage", "0", 6, 2, {2}, {1});
  pickle.text("model.other");
  add_tensor(pickle, "FloatStorage", "1", 1000000, 0, {1000000}, {1});
  pickle.op("u").text("optimizer").op("}").text("x");
  add_tensor(pickle, "FloatStorage", "2", 1000000, 0, {1000000}, {1});
  const auto path = archive(pickle.op("su").stop(), {{"data/0", six_}});
  std::filesystem::rename(path, folder_ / "model.bin");
  const NamedArrays part = read_state_below(folder_ / "model.bin", "model.part.");
  ASSERT_EQ(part.size(), 1u);
  EXPECT_EQ(part[0].first, "weight");
  EXPECT_EQ(part[0].second.as<float>(), (std::vector<float>{3, 4}));
  EXPECT_THROW(read_state_below(folder_ / "model.bin", "model."), InputError) << "a storage that is not there";
  EXPECT_TRUE(read_state_below(folder_ / "model.bin", "decoder.").empty());

  write_safetensors(folder_ / "model.safetensors",
                    {{"model.other", part[0].second}, {"model.part.bias", part[0].second}});
  const NamedArrays safe = read_state_below(folder_ / "model.safetensors", "model.part.");
  ASSERT_EQ(safe.size(), 1u);
  EXPECT_EQ(safe[0].first, "bias");
  EXPECT_EQ(safe[0].second.bytes, part[0].second.bytes);
}

TEST_F(TorchArchive, RefusesDamage) {
  const auto one = [](int count, int offset, const std::vector<int>& shape, const std::vector<int>& stride) {
    PickleBuilder pickle;
    pickle.op("}").text("x");
    add_tensor(pickle, "FloatStorage", "0", count, offset, shape, stride);
    return pickle.op("s").stop();
  };
  const std::vector<ZipContent> storage = {{"data/0", six_}};
  EXPECT_EQ(problem(one(6, 0, {6}, {1}), storage), "accepted");
  EXPECT_NE(problem(one(6, 1, {6}, {1}), storage).find("beyond its storage"), std::string::npos);
  EXPECT_NE(problem(one(6, 0, {2, 3}, {4, 1}), storage).find("beyond its storage"), std::string::npos);
  EXPECT_NE(problem(one(6, 0, {2147483647, 2147483647, 2147483647}, {1, 1, 1}), storage).find("overflows"),
            std::string::npos);
  EXPECT_NE(problem(one(6, 0, {2147483647, 1000}, {0, 0}), storage).find("exceed by far"), std::string::npos);
  EXPECT_NE(problem(one(6, 0, {-1}, {1}), storage), "accepted");
  EXPECT_NE(problem(one(6, 0, {1}, {-1}), storage), "accepted");
  EXPECT_NE(problem(one(6, 0, {1}, {1, 1}), storage).find("strides"), std::string::npos);
  EXPECT_NE(problem(one(5, 0, {5}, {1}), storage).find("24 bytes"), std::string::npos);
  EXPECT_NE(problem(one(6, 0, {6}, {1}), {}).find("the archive lacks"), std::string::npos);
  EXPECT_NE(problem("cposix\nsystem\n.", storage).find("posix.system"), std::string::npos);
  EXPECT_NE(problem("}q\x01X\x01" + little(0, 3) + "ah\x01s.", storage).find("contain themselves"), std::string::npos);
  PickleBuilder clash;
  clash.op("}").mark().text("a.b").integer(1).text("a").op("}").text("b").integer(2).op("su");
  EXPECT_NE(problem(clash.stop(), {}).find("two values have the path 'a.b'"), std::string::npos);
  EXPECT_NE(problem("ctorch\nComplexFloatStorage\n.", {}).find("torch.ComplexFloatStorage"), std::string::npos);
}

TEST_F(TorchArchive, RefusesOtherContainers) {
  const auto thrown = [&](const std::string& bytes) {
    write_file_atomically(folder_ / "y.pt", bytes);
    try {
      read_torch_archive(folder_ / "y.pt");
    } catch (const NotSupportedError& error) {
      return std::string("not supported");
    } catch (const InputError& error) {
      return std::string(error.what());
    }
    return std::string("accepted");
  };
  EXPECT_EQ(thrown(raw("\x80\x02\x8a\x0a\x6c\xfc\x9c\x46\xf9\x20\x6a\xa8\x50\x19.")), "not supported");
  EXPECT_NE(thrown("").find("zip"), std::string::npos);
  write_zip(folder_ / "z.pt", {{"archive/weights", "x"}});
  EXPECT_THROW(read_torch_archive(folder_ / "z.pt"), InputError);
  EXPECT_THROW(read_state_dict(folder_ / "weights.ckpt"), NotSupportedError);
}

TEST_F(TorchArchive, StateDictsDropTheDistributedPrefix) {
  const NdArray one = NdArray::from<float>({1}, {1});
  write_safetensors(folder_ / "a.safetensors", {{"module.x", one}, {"y.module.z", one}});
  const NamedArrays state = read_state_dict(folder_ / "a.safetensors");
  EXPECT_EQ(state[0].first, "x");
  EXPECT_EQ(state[1].first, "e.z");  // seven characters of every key, as the published loader does
  write_safetensors(folder_ / "b.safetensors", {{"x", one}, {"module.y", one}});
  EXPECT_EQ(read_state_dict(folder_ / "b.safetensors")[1].first, "module.y");
}

TEST_F(TorchArchive, DamagedFilesOnlyThrow) {
  PickleBuilder pickle;
  pickle.global("collections", "OrderedDict").op(")").reduce().mark().text("a");
  add_tensor(pickle, "FloatStorage", "0", 6, 0, {2, 2}, {2, 1});
  pickle.text("b");
  add_tensor(pickle, "FloatStorage", "0", 6, 4, {2}, {1});
  const std::string bytes = pickle.op("u").stop();
  const auto read = [](const auto& file) { read_torch_archive(file); };
  EXPECT_GT(test::read_damaged(read_file(archive(bytes, {{"data/0", six_}})), "x.pt", read), 100);
  // Past the checksum: damage inside the pickle itself.
  const auto read_pickle = [&](const std::filesystem::path& file) {
    test::write_quickly(folder_ / "y.pt", test::stored_zip({{"y/data.pkl", read_file(file)}, {"y/data/0", six_}}));
    read(folder_ / "y.pt");
  };
  EXPECT_GT(test::read_damaged(bytes, "data.pkl", read_pickle), 100);
}

// ---- files that PyTorch itself wrote ----

std::vector<std::filesystem::path> fixtures(const char* folder) {
  std::vector<std::filesystem::path> files;
  const auto root = test::parity_file(folder);
  if (!std::filesystem::exists(root)) return files;
  for (const auto& entry : std::filesystem::recursive_directory_iterator(root)) {
    if (entry.path().extension() == ".pt") files.push_back(entry.path());
  }
  return files;
}

TEST(TorchArchiveFixtures, AllRead) {
  for (const char* folder : {"ckpt_selection", "ckpt_tree"}) {
    const auto files = fixtures(folder);
    if (files.empty()) {
      GTEST_SKIP() << "no checkpoints in " << test::parity_file(folder);
    }
    for (const auto& file : files) {
      NamedArrays state;
      ASSERT_NO_THROW(state = read_state_dict(file)) << file;
      EXPECT_FALSE(state.empty()) << file;
      std::set<Dtype> dtypes;
      for (const auto& [name, array] : state) {
        EXPECT_NE(name.compare(0, 7, "module."), 0) << file;
        EXPECT_EQ(array.bytes.size(), array.count() * size_of(array.dtype)) << file << " " << name;
        dtypes.insert(array.dtype);
        if (file.filename().string().find("misc") != std::string::npos || array.dtype == Dtype::kI64) continue;
        for (const float value : array.as<float>()) ASSERT_TRUE(std::isfinite(value)) << file << " " << name;
      }
    }
  }
}

TEST(TorchArchiveFixtures, FlowsHaveTheSizesOfTheirConfigs) {
  const auto folder = test::parity_file("ckpt_tree/ckpts/anigen/ss_flow_solo");
  if (!std::filesystem::exists(folder)) {
    GTEST_SKIP() << "no " << folder;
  }
  const Json args = read_json(folder / "config.json")["models"]["denoiser"]["args"];
  const auto width = args["model_channels"].get<std::int64_t>(), blocks = args["num_blocks"].get<std::int64_t>();
  for (const char* name : {"denoiser.pt", "denoiser_ema0.9999.pt"}) {
    const NamedArrays state = read_torch_archive(folder / "ckpts" / name);
    using Shape = std::vector<std::int64_t>;
    ASSERT_NE(find(state, "input_layer.weight"), nullptr);
    EXPECT_EQ(find(state, "input_layer.weight")->shape[0], width);
    EXPECT_EQ(find(state, "out_layer.weight")->shape, (Shape{args["out_channels"].get<std::int64_t>(), width}));
    for (std::int64_t block = 0; block < blocks; ++block) {
      const NdArray* qkv = find(state, "blocks." + std::to_string(block) + ".self_attn.to_qkv.weight");
      ASSERT_NE(qkv, nullptr);
      EXPECT_EQ(qkv->shape, (Shape{3 * width, width}));
    }
    EXPECT_EQ(find(state, "blocks." + std::to_string(blocks) + ".self_attn.to_qkv.weight"), nullptr);
  }
}

TEST(TorchArchiveFixtures, MiscHoldsOptimiserState) {
  const auto file = test::parity_file("ckpt_selection/no_ema/ckpts/misc_step0000007.pt");
  if (!std::filesystem::exists(file)) {
    GTEST_SKIP() << "no " << file;
  }
  const NamedArrays state = read_torch_archive(file);
  ASSERT_NE(find(state, "optimizer.state.0.exp_avg"), nullptr);
  EXPECT_EQ(find(state, "optimizer.state.0.exp_avg")->dtype, Dtype::kF32);
  ASSERT_NE(find(state, "optimizer.param_groups.0.lr"), nullptr);
  EXPECT_GT(find(state, "optimizer.param_groups.0.lr")->as<double>()[0], 0.0);
  EXPECT_NE(find(state, "data_sampler.epoch"), nullptr);
}

}  // namespace
}  // namespace anigen::io
