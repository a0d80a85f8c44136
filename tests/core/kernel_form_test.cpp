#include "anigen/core/kernel_form.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <string>

#include "anigen/core/error.h"

namespace anigen {
namespace {

std::string refusal_of(const std::string& value) {
  try {
    requested_kernel_form(value);
  } catch (const InputError& error) {
    return error.what();
  }
  return "accepted";
}

TEST(KernelForm, EveryNameMeansItsForm) {
  EXPECT_EQ(requested_kernel_form(""), runnable_kernel_forms().back());
  EXPECT_EQ(requested_kernel_form("portable"), KernelForm::kPortable);
  for (const KernelForm form : runnable_kernel_forms())
    EXPECT_EQ(requested_kernel_form(kernel_form_name(form)), form) << kernel_form_name(form);
  EXPECT_EQ(runnable_kernel_forms().front(), KernelForm::kPortable);
  EXPECT_TRUE(std::is_sorted(runnable_kernel_forms().begin(), runnable_kernel_forms().end()));
}

TEST(KernelForm, UnknownNamesAreRefusedWithThoseThereAre) {
  for (const char* value : {"sse", "AVX2", "avx512 ", "0"}) {
    const std::string refusal = refusal_of(value);
    EXPECT_NE(refusal.find("ANIGEN_KERNELS"), std::string::npos) << refusal;
    EXPECT_NE(refusal.find('"' + std::string(value) + '"'), std::string::npos) << refusal;
    EXPECT_NE(refusal.find("portable, avx2, avx512, avx512bf16 or amx"), std::string::npos) << refusal;
  }
}

TEST(KernelForm, FormsThatTheProcessorDoesNotRunAreRefused) {
  for (const KernelForm form : {KernelForm::kAvx2, KernelForm::kAvx512, KernelForm::kAvx512Bf16, KernelForm::kAmx}) {
    const bool runs = form <= runnable_kernel_forms().back();
    const std::string refusal = refusal_of(kernel_form_name(form));
    EXPECT_EQ(refusal == "accepted", runs) << refusal;
    if (runs) continue;
    EXPECT_NE(refusal.find("this processor"), std::string::npos) << refusal;
    EXPECT_THROW(KernelFormScope{form}, InputError);
  }
}

TEST(KernelForm, AScopeLastsUntilItsEnd) {
  const KernelForm before = kernel_form();
  {
    const KernelFormScope portable(KernelForm::kPortable);
    EXPECT_EQ(kernel_form(), KernelForm::kPortable);
    EXPECT_EQ(kernel_form_details().rfind("kernels portable ", 0), 0U) << kernel_form_details();
    {
      const KernelFormScope widest(runnable_kernel_forms().back());
      EXPECT_EQ(kernel_form(), runnable_kernel_forms().back());
    }
    EXPECT_EQ(kernel_form(), KernelForm::kPortable);
  }
  EXPECT_EQ(kernel_form(), before);
}

#if defined(__x86_64__) && defined(__GNUC__) && !defined(__clang__)
// a b + c: 0 when the product is rounded first, 2^-24 when it is fused with the sum.
constexpr float kFactor = 1.0F + 1.0F / 4096.0F, kRest = -1.0F - 1.0F / 2048.0F;

ANIGEN_KERNEL(void, multiply_and_add, (const float* a, const float* b, float* c), (a, b, c)) { *c += *a * *b; }
ANIGEN_EXACT_KERNEL(void, multiply_and_add_exactly, (const float* a, const float* b, float* c), (a, b, c)) {
  *c += *a * *b;
}

float left_of(void (*kernel)(const float*, const float*, float*)) {
  float rest = kRest;
  kernel(&kFactor, &kFactor, &rest);
  return rest;
}

__attribute__((target("avx512f"))) void written_for_avx512(const float* a, const float* b, float* c) { *c += *a * *b; }
void written_for_all(const float* a, const float* b, float* c) { *c += *a * *b; }

// In optimised builds, code for AVX-512 fuses and other code does not.
TEST(KernelForm, KernelsRunInTheFormInUse) {
  for (const KernelForm form : runnable_kernel_forms()) {
    const KernelFormScope scope(form);
    auto* const like = form >= KernelForm::kAvx512 ? written_for_avx512 : written_for_all;
    EXPECT_EQ(left_of(multiply_and_add), left_of(like)) << kernel_form_name(form);
    EXPECT_EQ(left_of(multiply_and_add_exactly), left_of(written_for_all)) << kernel_form_name(form);
  }
}
#endif

}  // namespace
}  // namespace anigen
