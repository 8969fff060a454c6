// Processor time of a browser, and medians.
export async function processorMeter(browser) {
  const session = await browser.newBrowserCDPSession();
  /** seconds that all of the browser's processes have computed */
  return async () => {
    const { processInfo } = await session.send('SystemInfo.getProcessInfo');
    return processInfo.reduce((sum, process) => sum + process.cpuTime, 0);
  };
}

export const median = (values) => [...values].sort((a, b) => a - b)[Math.floor(values.length / 2)];
export const kilobytes = (bytes) => (bytes / 1000).toFixed(0);
