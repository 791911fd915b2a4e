// A corner of the box in clip space.
fn cornerInClip(position: vec3f) -> vec4f {
  var clip = u_toClip() * vec4f(position, 1.0);
  // What lies before the camera's far plane is seen, though the box's far sides are behind it.
  let end = u_farEnd();
  clip.z = end.y * min(end.y * clip.z, end.y * end.x * clip.w);
  return clip;
}
