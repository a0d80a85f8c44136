#include "anigen/core/kernel_form.h"

#include <algorithm>
#include <cstdlib>
#include <iterator>

#if defined(__x86_64__) && defined(__GNUC__)
#include <cpuid.h>
#endif
#if defined(__linux__)
#include <sys/syscall.h>
#include <unistd.h>
#endif

#include "anigen/core/error.h"
#include "anigen/core/text.h"

namespace anigen {

namespace {

constexpr KernelForm kForms[] = {KernelForm::kPortable, KernelForm::kAvx2, KernelForm::kAvx512, KernelForm::kAvx512Bf16,
                                 KernelForm::kAmx};

#if defined(__x86_64__) && defined(__GNUC__)
// The processor has tiles of bf16 numbers, and the system lets this process use them: Linux asks that of every process.
bool has_amx() {
  unsigned a = 0, b = 0, c = 0, d = 0;
  constexpr unsigned kFeatures = 7, kAmxBf16 = 1U << 22U, kAmxTile = 1U << 24U;
  if (__get_cpuid_count(kFeatures, 0, &a, &b, &c, &d) == 0 || (d & kAmxBf16) == 0 || (d & kAmxTile) == 0) return false;
#if defined(__linux__)
  constexpr long kRequestPermission = 0x1023, kTileData = 18;
  return syscall(SYS_arch_prctl, kRequestPermission, kTileData) == 0;
#else
  return false;
#endif
}
#endif

bool runs(KernelForm form) {
  if (form == KernelForm::kPortable) return true;
#if defined(__x86_64__) && defined(__GNUC__)
  const bool avx2 = __builtin_cpu_supports("avx2") != 0 && __builtin_cpu_supports("fma") != 0;
  const bool avx512 = avx2 && __builtin_cpu_supports("avx512f") != 0;
  if (form == KernelForm::kAvx2) return avx2;
  if (form == KernelForm::kAvx512) return avx512;
  const bool bf16 = avx512 && __builtin_cpu_supports("avx512bf16") != 0 && __builtin_cpu_supports("avx512bw") != 0 &&
                    __builtin_cpu_supports("avx512vl") != 0 && __builtin_cpu_supports("avx512dq") != 0;
  return form == KernelForm::kAvx512Bf16 ? bf16 : bf16 && has_amx();
#else
  return false;
#endif
}

std::string names(const std::vector<KernelForm>& forms) { return joined(forms, ", ", kernel_form_name); }

void require_runnable(KernelForm form) {
  const std::vector<KernelForm>& forms = runnable_kernel_forms();
  if (std::find(forms.begin(), forms.end(), form) != forms.end()) return;
  throw InputError("", "ANIGEN_KERNELS",
                   std::string("this processor does not run kernels in the form ") + kernel_form_name(form) +
                       "; it runs " + names(forms));
}

}  // namespace

std::atomic<int> kernel_forms::current{-1};

KernelForm kernel_forms::first_choice() {
  const char* value = std::getenv("ANIGEN_KERNELS");
  const KernelForm form = requested_kernel_form(value == nullptr ? "" : value);
  int nothing = -1;
  current.compare_exchange_strong(nothing, static_cast<int>(form));
  return static_cast<KernelForm>(current.load());
}

const char* kernel_form_name(KernelForm form) {
  static constexpr const char* kNames[] = {"portable", "avx2", "avx512", "avx512bf16", "amx"};
  return kNames[static_cast<int>(form)];
}

const std::vector<KernelForm>& runnable_kernel_forms() {
  static const std::vector<KernelForm> forms = [] {
    std::vector<KernelForm> found;
    std::copy_if(std::begin(kForms), std::end(kForms), std::back_inserter(found), runs);
    return found;
  }();
  return forms;
}

KernelForm requested_kernel_form(const std::string& value) {
  if (value.empty()) return runnable_kernel_forms().back();
  for (const KernelForm form : kForms) {
    if (value != kernel_form_name(form)) continue;
    require_runnable(form);
    return form;
  }
  throw InputError(
      "", "ANIGEN_KERNELS",
      "unknown form of kernels \"" + value + "\"; set it to portable, avx2, avx512, avx512bf16 or amx, or unset it");
}

std::string kernel_form_details() {
  return std::string("kernels ") + kernel_form_name(kernel_form()) + " (this processor runs " +
         names(runnable_kernel_forms()) + ")";
}

KernelFormScope::KernelFormScope(KernelForm form) : before_(kernel_form()) {
  require_runnable(form);
  kernel_forms::current = static_cast<int>(form);
}

KernelFormScope::~KernelFormScope() { kernel_forms::current = static_cast<int>(before_); }

}  // namespace anigen
