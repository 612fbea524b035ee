// SIMD packs of lanes (GCC and Clang vector extensions: SSE2, AVX, AVX-512 or NEON) and the choice of the
// instruction set when the program is loaded.
#pragma once

#include <cstddef>
#include <cstring>

namespace teres {

template <class T, std::size_t kLanes>
struct PackOf {
    typedef T type __attribute__((vector_size(kLanes * sizeof(T)), aligned(alignof(T)), may_alias));
};
template <class T, std::size_t kLanes>
using LanePack = typename PackOf<T, kLanes>::type;

template <class P, class T>
inline P load_pack(const T* from) {
    P v;
    std::memcpy(&v, from, sizeof v);
    return v;
}
template <class P, class T>
inline void store_pack(T* to, const P& v) {
    std::memcpy(to, &v, sizeof v);
}

}  // namespace teres

// One copy per instruction set.
#if defined(__x86_64__) && defined(__GNUC__) && !defined(__clang__) && !defined(__SANITIZE_ADDRESS__) && \
    !defined(__SANITIZE_THREAD__)
#define TERES_MULTIVERSION __attribute__((target_clones("arch=x86-64-v4", "arch=x86-64-v3", "default"), flatten))
#else
#define TERES_MULTIVERSION
#endif
