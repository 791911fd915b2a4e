/** Waits for the device without blocking the page. */

/** Calls back asynchronously when the device has finished all its work, or was lost. */
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
