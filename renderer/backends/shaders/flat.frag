#version 330 core
// A point's colour is the interpolated vertex colour of the side that is seen times its texture's.
struct Material {
#ifdef HAS_BASE_COLOR_TEX
    sampler2D base_color_texture;
#endif
    vec4 base_color_factor;
};
uniform Material material;

#ifdef TEXCOORD_0_LOC
in vec2 uv;
#endif
in vec4 color;
#ifdef NORMAL_LOC
in vec3 back;
#endif
out vec4 frag_color;

void main()
{
    vec4 product = color;
#ifdef NORMAL_LOC
    if (!gl_FrontFacing) product.rgb = back;
#endif
#ifdef HAS_BASE_COLOR_TEX
    product *= texture(material.base_color_texture, uv);
#endif
    // The vertex alpha was scaled so that every part's cutoff is one half.
    if (product.a < 0.5) discard;
    frag_color = vec4(clamp(product.rgb, 0.0, 1.0), 1.0);
}
