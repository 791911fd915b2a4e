/** Waiting for the device without holding the page up. */

/** Calls back, never at once, when the device has done all that it was told; also where it was lost meanwhile. */
export function whenDone(gl: WebGL2RenderingContext, then: () => void): void {
  const fence = gl.fenceSync(gl.SYNC_GPU_COMMANDS_COMPLETE, 0);
  gl.flush();
  const look = () => {
    if (fence && !gl.isContextLost() && gl.getSyncParameter(fence, gl.SYNC_STATUS) === gl.UNSIGNALED) {
      setTimeout(look, 1);
      return;
    }
    gl.deleteSync(fence);
    then();
  };
  setTimeout(look);
}
