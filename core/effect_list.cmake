# teres_effect_list(<names> <file> <Base> <header> <Scene> <function>)
#   names: list of effect ids; each has a file <id>.cpp that defines  std::unique_ptr<Base> make_<id>(const Scene&).
#   Writes `file`: the function that makes all of them, in the order of the list.
function(teres_effect_list names file Base header Scene function)
  set(declarations "")
  set(calls "")
  foreach(id ${${names}})
    string(APPEND declarations "std::unique_ptr<${Base}> make_${id}(const ${Scene}&);\n")
    string(APPEND calls "    effects.push_back(make_${id}(scene));\n")
  endforeach()
  file(CONFIGURE OUTPUT ${file} CONTENT "// Made by CMake from the list of effects.
#include \"${header}\"

namespace teres {

${declarations}
std::vector<std::unique_ptr<${Base}>> ${function}(const ${Scene}& scene) {
    std::vector<std::unique_ptr<${Base}>> effects;
${calls}    return effects;
}

}  // namespace teres
")
endfunction()
