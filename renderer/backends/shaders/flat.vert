#version 330 core
// Vertex attributes; pyrender numbers the locations.
layout(location = 0) in vec3 position;
#ifdef NORMAL_LOC
layout(location = NORMAL_LOC) in vec3 back_color;  // of parts whose sides differ
#endif
#ifdef TEXCOORD_0_LOC
layout(location = TEXCOORD_0_LOC) in vec2 texcoord_0;
#endif
layout(location = COLOR_0_LOC) in vec4 color_0;
layout(location = INST_M_LOC) in mat4 inst_m;

uniform mat4 M;
uniform mat4 V;
uniform mat4 P;

#ifdef TEXCOORD_0_LOC
out vec2 uv;
#endif
out vec4 color;
#ifdef NORMAL_LOC
out vec3 back;
#endif

void main()
{
    gl_Position = P * V * M * inst_m * vec4(position, 1.0);
#ifdef TEXCOORD_0_LOC
    uv = texcoord_0;
#endif
    color = color_0;
#ifdef NORMAL_LOC
    back = back_color;
#endif
}
