#version 330 core
// A point's colour is its interpolated vertex colour times its texture's, the same from all directions.
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
out vec4 frag_color;

void main()
{
    vec4 product = color;
#ifdef HAS_BASE_COLOR_TEX
    product *= texture(material.base_color_texture, uv);
#endif
    // The vertex alpha was scaled so that every part's cutoff is one half.
    if (product.a < 0.5) discard;
    frag_color = vec4(clamp(product.rgb, 0.0, 1.0), 1.0);
}
